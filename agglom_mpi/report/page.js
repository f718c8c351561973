"use strict";
// Without this script the page shows the same: tables in their own order, links instead of values.

const UNITS = { ns: 1e-9, "µs": 1e-6, ms: 1e-3, s: 1, min: 60, h: 3600, days: 86400 };
const REACH = 14; // pixels around the pointer in which a mark is found

// The number at the start of a text in the unit behind it, or the text in small letters.
function sortKey(text) {
  const found = text.match(/^#?([-+]?(?:\d[\d,]*)?\.?\d+(?:e[-+]?\d+)?)(%?)(?:\s+([a-zµ]+))?(?:\s|$)/i);
  if (!found) return text.toLowerCase();
  return Number(found[1].replaceAll(",", "")) * (UNITS[found[3]] ?? 1);
}

function compare(first, second) {
  if (typeof first === typeof second) return first < second ? -1 : Number(first > second);
  return typeof first === "number" ? -1 : 1;
}

function sortBy(heading) {
  const table = heading.closest("table");
  const place = [...heading.parentNode.children].indexOf(heading);
  const direction = heading.getAttribute("aria-sort") === "ascending" ? -1 : 1;
  const rows = [...table.tBodies[0].rows].map((row) => [row.cells[place].textContent.trim(), row]);
  const [full, empty] = [rows.filter(([text]) => text), rows.filter(([text]) => !text)];
  full.sort(([a], [b]) => direction * compare(sortKey(a), sortKey(b)));
  table.tBodies[0].append(...full.map(([, row]) => row), ...empty.map(([, row]) => row));
  for (const each of heading.parentNode.children) each.setAttribute("aria-sort", "none");
  heading.setAttribute("aria-sort", direction > 0 ? "ascending" : "descending");
}

for (const heading of document.querySelectorAll("thead th")) {
  heading.setAttribute("aria-sort", "none");
  const button = document.createElement("button");
  button.append(...heading.childNodes);
  heading.append(button);
  heading.addEventListener("click", () => sortBy(heading));
}

// Long texts are open without a script and on paper, and folded with one.
const folded = document.querySelectorAll("details.long");
for (const details of folded) details.open = false;
let opened = [];
addEventListener("beforeprint", () => {
  opened = [...folded].filter((details) => !details.open);
  for (const details of opened) details.open = true;
});
addEventListener("afterprint", () => {
  for (const details of opened) details.open = false;
});

const box = document.createElement("div");
box.className = "values";
box.setAttribute("role", "status");
box.hidden = true;
document.body.append(box);

// The values of a string, from its row in the table of all strings.
function valuesOf(link) {
  const row = document.getElementById(link.getAttribute("href").slice(1));
  if (!row) return "";
  return [...row.cells].filter((cell) => cell.textContent)
    .map((cell) => `${cell.dataset.label}: ${cell.textContent}`).join("\n");
}

// The link of the mark under the pointer, or else of the nearest one within reach.
function linkAt(svg, event) {
  const under = event.target.closest("a[href^='#string-']");
  if (under) return under;
  let [nearest, least] = [null, REACH];
  for (const mark of svg.querySelectorAll("a[href^='#string-'] use")) {
    const place = mark.getBoundingClientRect();
    const distance = Math.hypot(
      place.x + place.width / 2 - event.clientX, place.y + place.height / 2 - event.clientY);
    if (distance < least) [nearest, least] = [mark.closest("a"), distance];
  }
  return nearest;
}

let shown = null;
function show(link, event) {
  if (link?.getAttribute("href") !== shown) {
    shown = link?.getAttribute("href") ?? null;
    for (const each of document.querySelectorAll("figure a.same")) each.classList.remove("same");
    if (shown) {
      for (const each of document.querySelectorAll(`figure a[href='${shown}']`)) each.classList.add("same");
      box.textContent = valuesOf(link);
    }
    box.hidden = !shown || !box.textContent;
  }
  if (!box.hidden) {
    const [right, low] = [innerWidth - box.offsetWidth - 8, innerHeight - box.offsetHeight - 8];
    box.style.left = `${Math.max(8, Math.min(event.clientX + 14, right))}px`;
    box.style.top = `${Math.max(8, Math.min(event.clientY + 14, low))}px`;
  }
}

// The arrow keys show the values of one string of a figure after the other, in order of the table.
function withKeys(svg) {
  const mark = (row) => row && svg.querySelector(`a[href='#${row.id}']`);
  const rows = () => [...document.querySelectorAll("tr[id^='string-']")].filter(mark);
  const showRow = (row) => {
    const link = mark(row);
    link?.scrollIntoView({ block: "nearest" });
    const place = (link ?? svg).getBoundingClientRect();
    show(link, { clientX: place.x + place.width / 2, clientY: place.y + place.height / 2 });
  };
  const hint = document.createElement("span");
  hint.className = "keys";
  hint.textContent = "The arrow keys show the strings, Enter leads to a row. ";
  svg.closest("figure").querySelector("figcaption a").before(hint);
  svg.tabIndex = 0;
  svg.addEventListener("focus", () => svg.matches(":focus-visible") && showRow(rows()[0]));
  svg.addEventListener("blur", () => showRow(null));
  svg.addEventListener("keydown", (event) => {
    const all = rows();
    const now = all.findIndex((row) => `#${row.id}` === shown);
    const next = { ArrowRight: now + 1, ArrowDown: now + 1, ArrowLeft: now - 1, ArrowUp: now - 1,
      Home: 0, End: all.length - 1 }[event.key];
    if (next !== undefined) showRow(all[Math.max(0, Math.min(next, all.length - 1))]);
    else if (event.key === "Enter" && shown) location.hash = shown;
    else if (event.key === "Escape") showRow(null);
    else return;
    event.preventDefault();
  });
}

for (const svg of document.querySelectorAll("figure svg")) {
  if (!svg.querySelector("a[href^='#string-']")) continue;
  svg.addEventListener("pointermove", (event) => show(linkAt(svg, event), event));
  svg.addEventListener("pointerleave", (event) => show(null, event));
  withKeys(svg);
}
