// The table of a frame, in pages that keyboards and screen readers can walk.

import { count, figure, h } from "./dom";
import type { Rows } from "./rows";

const PAGE = 25;
const SHOWN = ["target", "point_id", "microlens_k", "microlens_l", "microlens_type", "x_px", "y_px", "rho_px", "hit_fraction", "visibility"];

/** A closed table; a row's button goes to its point in the image. */
export function tableOf(rows: Rows, goTo: (row: number) => void): HTMLElement {
  const names = SHOWN.filter((name) => rows.names.includes(name));
  const body = h("tbody", {});
  const where = h("span", { "aria-live": "polite" });
  let first = 0;
  const show = (from: number) => {
    first = Math.min(Math.max(0, from), Math.max(0, rows.length - 1));
    first -= first % PAGE;
    const last = Math.min(first + PAGE, rows.length);
    where.textContent = rows.length ? `rows ${count(first + 1)} to ${count(last)} of ${count(rows.length)}` : "no rows";
    body.replaceChildren(...Array.from({ length: last - first }, (_, i) => {
      const row = first + i;
      const go = h("button", { type: "button", class: "go", onclick: () => goTo(row), "aria-label": `go to row ${row + 1}` }, "show");
      return h("tr", {}, h("td", {}, go), ...names.map((name) => cell(rows.cell(name, row))));
    }));
  };
  const step = (by: number, name: string) => h("button", { type: "button", onclick: () => show(first + by * PAGE) }, name);
  show(0);
  return h("details", { class: "frame-table" },
    h("summary", {}, `Table of this frame: ${count(rows.length)} rows`),
    h("div", { class: "pager" }, step(-1, "← before"), step(1, "next →"), where),
    h("div", { class: "scroll" }, h("table", {}, h("thead", {}, h("tr", {}, h("th", {}), ...names.map((name) => h("th", { scope: "col" }, name)))), body)));
}

function cell(value: number | string | null): HTMLElement {
  const isNumber = typeof value === "number";
  return h("td", { class: isNumber ? "number" : "", title: value ?? "" }, isNumber && !Number.isInteger(value) ? figure(value, 7) : String(value ?? "–"));
}
