// Requests to the server that served this page. Addresses are relative: the token is part of the page's own.

/** Somebody else has changed the frame since: what is there now. */
export class Conflict extends Error {
  constructor(now) {
    super("changed elsewhere");
    this.now = now;
  }
}

/** The server does not answer: unlike its refusals, that may pass. */
export class Unreachable extends Error {}

async function request(path, options = {}) {
  let response;
  try {
    response = await fetch(path, options);
  } catch {
    throw new Unreachable("gtlayout annotate does not answer: is it still running?");
  }
  if (response.status === 409) throw new Conflict(await response.json());
  if (!response.ok) throw new Error(await response.text());
  return response.json();
}

const withBody = (method, body) => ({
  method, body: JSON.stringify(body), headers: { "Content-Type": "application/json" },
});

export const get = (path) => request(path);
export const put = (path, body) => request(path, withBody("PUT", body));
export const post = (path, body) => request(path, withBody("POST", body));
