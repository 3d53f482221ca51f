"use strict";
// Numbers by value, words by alphabet; what was not measured comes last in both directions.
function compare(first, second, column, kind, sign) {
  const [a, b] = [first, second].map((row) => row.cells[column].dataset.value);
  if (a === "" || b === "") return (a === "") - (b === "");
  return sign * (kind === "number" ? a - b : a.localeCompare(b));
}

for (const table of document.querySelectorAll("table.sortable")) {
  const body = table.tBodies[0];
  const parts = [...body.querySelectorAll("tr.part")];
  const headings = [...table.tHead.rows[0].cells];
  headings.forEach((heading, column) => heading.querySelector("button").addEventListener("click", () => {
    const ascending = heading.getAttribute("aria-sort") !== "ascending";
    headings.forEach((other) => other.removeAttribute("aria-sort"));
    heading.setAttribute("aria-sort", ascending ? "ascending" : "descending");
    parts.forEach((part) => part.remove());  // rows are no longer in parts
    body.append(...[...body.rows].sort((a, b) => compare(a, b, column, heading.dataset.kind, ascending ? 1 : -1)));
  }));
}

// A figure is in the page once; its link takes it from there.
for (const link of document.querySelectorAll("a[download]")) {
  link.href = link.closest("figure").querySelector("img").src;
}
