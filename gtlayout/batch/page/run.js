// The table of scenes. Ten thousand rows would take a browser seconds to lay out: only some are, more on demand.
const AT_A_TIME = 200;
const table = document.getElementById("table");
const find = document.getElementById("find");
const piles = [...document.querySelectorAll("[data-group]")];
const colors = { failed: "bad", redo: "bad", check: "warn", trust: "good" };
const { keys, rows } = JSON.parse(document.getElementById("rows").textContent);
const scenes = rows.map((values) => Object.fromEntries(keys.map((key, index) => [key, values[index]])));
for (const one of scenes) one.text = [one.name, one.verdict, one.status, one.redraw, one.reason].join("\n").toLowerCase();
let order = scenes;
let shown = AT_A_TIME;

// Names and reasons come from files: they are only ever text.
function made(tag, className, ...content) {
  const element = document.createElement(tag);
  element.className = className;
  element.append(...content);
  return element;
}

function figure(className, value, said) {
  const cell = made("td", `n ${className}`, value === null ? "–" : said(value));
  cell.dataset.number = value ?? "";
  return cell;
}

function words(className, value, ...content) {
  const cell = made("td", className, ...content);
  cell.dataset.value = value;
  return cell;
}

function rowOf(one) {
  const failed = one.group === "failed";
  const link = made("a", "", one.name);
  link.href = `${one.folder}/${failed ? table.dataset.log : table.dataset.page}`;
  if (!failed) {
    const image = made("img", "");
    image.loading = "lazy";
    image.alt = "";
    image.src = `${one.folder}/${table.dataset.thumbnail}`;
    link.prepend(image);
  }
  const redraw = one.redraw_iou === null ? [] : [" ", made("span", "soft", one.redraw_iou.toFixed(3))];
  return made(
    "tr", one.group,
    words("scene", one.name, link),
    words("status", one.verdict, made("b", colors[one.group], one.verdict), " ", made("span", "soft", one.status)),
    figure("iou", one.iou, (value) => value.toFixed(3)),
    figure("sigma", one.sigma, (value) => `${(100 * value).toFixed(1)} %`),
    figure("error", one.depth_error, (value) => `${(100 * value).toFixed(1)} c${one.unit}`),
    figure("weak", one.weak, (value) => `${value} of ${one.instances ?? "–"}`),
    words("redraw", one.redraw, one.redraw, ...redraw),
    words("why", one.reason, made("p", "", one.reason)),
    figure("time", one.seconds, (value) => `${value.toFixed(1)} s`),
    figure("memory", one.memory, (value) => `${value.toFixed(0)} MiB`),
  );
}

function show() {
  const pile = piles.find((button) => button.getAttribute("aria-pressed") === "true").dataset.group;
  const wanted = find.value.trim().toLowerCase();
  const chosen = order.filter((one) => (pile === "" || one.group === pile) && one.text.includes(wanted));
  table.tBodies[0].replaceChildren(...chosen.slice(0, shown).map(rowOf));
  document.getElementById("shown").textContent = chosen.length < scenes.length ? `${chosen.length} found` : "";
  const more = document.getElementById("more");
  more.hidden = chosen.length <= shown;
  more.textContent = `Show ${Math.min(AT_A_TIME, chosen.length - shown)} more of ${chosen.length}`;
}

function showFirst() {
  shown = AT_A_TIME;
  show();
}

function press(chosen) {
  for (const button of piles) button.setAttribute("aria-pressed", String(button === chosen));
  showFirst();
}

if (table) {
  const columns = ["name", "verdict", "iou", "sigma", "depth_error", "weak", "redraw", "reason", "seconds", "memory"];
  const texts = ["name", "verdict", "redraw", "reason"];
  onSort(table, (column, descending) => {
    const key = columns[column];
    const said = (one) => (texts.includes(key) ? { value: one[key] } : { number: one[key] ?? "" });
    order = [...scenes].sort((a, b) => compare(said(a), said(b), descending));
    showFirst();
  });
  for (const button of piles) button.addEventListener("click", () => press(button));
  find.addEventListener("input", showFirst);
  document.getElementById("more").addEventListener("click", () => {
    shown += AT_A_TIME;
    show();
  });
  for (const button of document.querySelectorAll("[data-find]")) {
    button.addEventListener("click", () => {
      find.value = button.dataset.find;
      press(piles[0]);
      document.getElementById("scenes").scrollIntoView();
    });
  }
  show();
}
for (const one of document.querySelectorAll(".scenes")) {
  one.addEventListener("click", (event) => event.target.closest(".why")?.classList.toggle("whole"));
}

// Also pages that were opened from a file can copy this way.
document.getElementById("copy")?.addEventListener("click", () => {
  document.getElementById("send-back").select();
  const done = document.execCommand("copy");
  document.getElementById("copied").textContent = done ? "copied" : "selected: copy it with Ctrl-C";
});
