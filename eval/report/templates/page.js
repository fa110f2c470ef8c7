"use strict";
document.documentElement.classList.add("js");

// Sorting: the first click puts the better end on top, the next one turns the column around.
for (const head of document.querySelectorAll("th.sorts")) {
  head.tabIndex = 0;
  const sort = () => {
    const table = head.closest("table"), body = table.tBodies[0], at = head.cellIndex;
    const was = head.getAttribute("aria-sort");
    const up = was ? was === "descending" : head.dataset.better !== "higher";
    const value = (row) => parseFloat(row.cells[at].dataset.value);
    const name = (row) => row.cells[0].textContent.trim();
    const rows = [...body.rows].sort((a, b) => {
      if (at === 0) return (up ? 1 : -1) * name(a).localeCompare(name(b));
      const x = value(a), y = value(b);
      if (isNaN(x) && isNaN(y)) return (up ? 1 : -1) * a.cells[at].textContent.localeCompare(b.cells[at].textContent);
      if (isNaN(x) || isNaN(y)) return isNaN(x) - isNaN(y);
      return up ? x - y : y - x;
    });
    for (const other of table.querySelectorAll("th")) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    body.append(...rows);
  };
  head.addEventListener("click", sort);
  head.addEventListener("keydown", (event) => {
    if (event.key === "Enter" || event.key === " ") { event.preventDefault(); sort(); }
  });
}

// A click on a picture shows it as large as the window.
const dialog = document.createElement("dialog");
document.body.append(dialog);
dialog.addEventListener("click", () => dialog.close());
document.addEventListener("click", (event) => {
  const picture = event.target.closest("main .picture");
  if (!picture) return;
  const copy = picture.cloneNode(false), caption = document.createElement("p");
  for (const image of picture.querySelectorAll(":scope > :is(img, svg)"))
    if (getComputedStyle(image).display !== "none") {
      const shown = image.cloneNode(true);
      shown.style.display = "inline";
      copy.append(shown);
    }
  const base = picture.querySelector("img, svg"), box = base.getBoundingClientRect();
  caption.textContent = picture.closest("figure").querySelector("figcaption").innerText;
  dialog.style.setProperty("--aspect", base.naturalWidth / base.naturalHeight || box.width / box.height);
  dialog.source = picture.closest(".linked");
  const readout = document.createElement("p");
  readout.className = "readout";
  dialog.replaceChildren(copy, readout, caption);
  dialog.showModal();
});
