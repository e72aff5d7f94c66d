// Tables of class "sortable": a click on a heading sorts by its column, a second one the other way round.
for (const table of document.querySelectorAll("table.sortable")) {
  onSort(table, (column, descending) => {
    const body = table.tBodies[0];
    const order = (a, b) => compare(a.cells[column].dataset, b.cells[column].dataset, descending);
    body.append(...[...body.rows].sort(order));
  });
}

function onSort(table, sort) {
  const headings = [...table.tHead.rows[0].cells];
  headings.forEach((heading, column) => heading.querySelector("button").addEventListener("click", () => {
    const descending = heading.getAttribute("aria-sort") === "ascending";
    for (const other of headings) other.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", descending ? "descending" : "ascending");
    sort(column, descending);
  }));
}

// Numbers by value, unknown ones always last; text by its natural order: wall_2 before wall_10.
const natural = new Intl.Collator("en", { numeric: true });
function compare(a, b, descending) {
  const sign = descending ? -1 : 1;
  if (a.number === undefined) return sign * natural.compare(a.value, b.value);
  if (a.number === "" || b.number === "") return (a.number === "") - (b.number === "");
  return sign * (a.number - b.number);
}
