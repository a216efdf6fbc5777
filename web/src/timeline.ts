// The history of a build: what was in the store, when tasks ran, and what they took.

import { LINES } from "./charts";
import { bytes, count, h, s, seconds } from "./dom";
import type { History, TaskRun } from "./records";

const STATES: [string, string, string][] = [["executed", "ran in the last build", "run"], ["failed", "failed", "bad"], ["cached", "found in the store", "ok"], ["made before", "made by earlier builds", "ok"]];

export function timelineOf(history: History): HTMLElement[] {
  return [h("div", { class: "panel" }, h("h3", {}, "Use of the store"), use(history), ...lanes(history)), h("div", { class: "panel" }, h("h3", {}, "Kinds of tasks"), kinds(history.tasks))];
}

function use(history: History): HTMLElement {
  const all = history.tasks.length || 1;
  const parts = STATES.map(([state, words, look]) => ({ words, look, many: history.tasks.filter((task) => task.state === state).length })).filter((part) => part.many);
  const said = parts.map((part) => `${count(part.many)} ${part.words}`).join(", ");
  return h("div", {},
    h("div", { class: "use", role: "img", "aria-label": said }, ...parts.map((part) => h("span", { class: part.look, style: `flex-grow:${part.many / all}` }))),
    h("p", {}, `${count(history.tasks.length)} tasks: ${said}`, history.seconds === null ? "." : ` · ${seconds(history.seconds)} with ${history.workers} worker${history.workers === 1 ? "" : "s"}.`));
}

/** Tasks that ran, each in the first lane that is free. */
function lanes(history: History): Element[] {
  const ran = history.tasks.filter((task) => task.start_s !== null && task.end_s !== null).sort((a, b) => a.start_s! - b.start_s!);
  if (!ran.length) return [h("p", { class: "muted" }, "When the tasks ran is not known: this report was written without a build.")];
  const ends: number[] = [];
  const whole = Math.max(...ran.map((task) => task.end_s!), 1e-3);
  const names = [...new Set(ran.map((task) => task.kind))];
  const [width, lane] = [1000, 20];
  const bars = ran.map((task) => {
    let row = ends.findIndex((end) => end <= task.start_s! + 0.02);
    if (row < 0) row = ends.length;
    ends[row] = task.end_s!;
    const x = (task.start_s! / whole) * width;
    return s("rect", { x: x.toFixed(2), y: row * lane + 2, width: Math.max(0.6, ((task.end_s! - task.start_s!) / whole) * width - 0.4).toFixed(2), height: lane - 4, rx: 2, ...filling(names.indexOf(task.kind)) },
      s("title", {}, `${task.name}: ${seconds(task.start_s)} to ${seconds(task.end_s)}`));
  });
  const ticks = Array.from({ length: 6 }, (_, i) => s("text", { x: (i / 5) * width, y: ends.length * lane + 16, class: "tick", "text-anchor": i === 0 ? "start" : i === 5 ? "end" : "middle" }, seconds((whole * i) / 5)));
  return [
    h("div", { class: "scroll" }, s("svg", { viewBox: `0 0 ${width} ${ends.length * lane + 22}`, class: "timeline", role: "img", "aria-label": `${ran.length} tasks in ${seconds(whole)}` }, ...bars, ...ticks)),
    h("p", { class: "legend" }, ...names.map((name, i) => h("span", {}, h("i", { style: `background:${filling(i).fill};opacity:${filling(i)["fill-opacity"]}` }), name))),
  ];
}

/** The colour of a kind of tasks: those of the lines, then the same ones, paler. */
function filling(number: number): { fill: string; "fill-opacity": number } {
  return { fill: LINES[number % LINES.length], "fill-opacity": number < LINES.length ? 1 : 0.45 };
}

function kinds(tasks: TaskRun[]): HTMLElement {
  const names = [...new Set(tasks.map((task) => task.kind))];
  const rows = names.map((name) => {
    const own = tasks.filter((task) => task.kind === name);
    return { name, many: own.length, ran: own.filter((task) => task.state === "executed").length, cpu: own.reduce((sum, task) => sum + (task.cpu_s ?? 0), 0), peak: Math.max(0, ...own.map((task) => task.peak_bytes ?? 0)) };
  }).sort((a, b) => b.cpu - a.cpu);
  const most = Math.max(...rows.map((row) => row.cpu), 1e-9);
  const body = rows.map((row) => h("tr", {}, h("th", { scope: "row" }, row.name), h("td", { class: "number" }, count(row.many)), h("td", { class: "number" }, row.ran ? count(row.ran) : "–"),
    h("td", { class: "number" }, seconds(row.cpu)), h("td", { class: "gauge-cell" }, h("span", { class: "gauge-bar", style: `width:${(100 * row.cpu) / most}%` })), h("td", { class: "number" }, row.peak ? bytes(row.peak) : "–")));
  return h("div", { class: "scroll" }, h("table", {}, h("thead", {}, h("tr", {}, ...["kind", "tasks", "ran now", "processor", "", "most memory"].map((name, i) => h("th", { scope: "col", class: i ? "number" : "" }, name)))), h("tbody", {}, ...body)));
}
