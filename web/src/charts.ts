// Curves by uPlot; histograms, spots and maps as SVG and canvas of their own.

import uPlot from "uplot";
import { colour, count, figure, h, measured, s } from "./dom";
import type { Chart, Histogram, Residuals, Spot } from "./records";

export const LINES = ["#2f7fe0", "#e8702a", "#27a05a", "#c8489a", "#8f63e8", "#b8901a", "#1a9aa8", "#d0483c"];

/** A chart with its title, and its values as a table for those who cannot see it. */
export function chartOf(chart: Chart): HTMLElement {
  const place = h("div", { class: "chart-place", role: "img", "aria-label": `${chart.title}: ${chart.lines.map((line) => line.name).join(", ")} over ${chart.x_name}` });
  const pairs = chart.lines.length > 2 && chart.lines.some((line) => line.is_dashed);
  const tint = (i: number) => LINES[(pairs ? Math.floor(i / 2) : i) % LINES.length];
  const axis = (name: string, size: number) => ({
    label: name, labelSize: 20, size, stroke: colour("muted"), grid: { stroke: colour("line"), width: 1 }, ticks: { stroke: colour("line"), width: 1 },
    font: "11px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif",
    values: (_: uPlot, values: number[]) => values.map((value) => (value === null ? "" : figure(value, 6))),
  });
  const options = (width: number): uPlot.Options => ({
    width, height: 250, legend: { show: true, live: true }, cursor: { points: { size: 6 } }, scales: { x: { time: false }, ...(chart.y_range ? { y: { range: chart.y_range as [number, number] } } : {}) },
    axes: [axis(chart.x_name, 34), axis(chart.y_name, 62)],
    series: [
      { label: chart.x_name, value: (_, value) => (value === null ? "" : figure(value, 4)) },
      ...chart.lines.map((line, i) => ({ label: line.name, stroke: tint(i), width: 2, dash: line.is_dashed ? [6, 4] : [], points: { show: false }, value: (_: uPlot, value: number | null) => (value === null ? "" : figure(value, 4)) })),
    ],
  });
  const data = [chart.x, ...chart.lines.map((line) => line.y)] as uPlot.AlignedData;
  let plot: uPlot | null = null;
  const fit = () => {
    const width = Math.floor(place.clientWidth);
    if (!width) return;
    if (plot) plot.setSize({ width, height: 250 });
    else plot = new uPlot(options(width), data, place);
  };
  new ResizeObserver(() => requestAnimationFrame(fit)).observe(place); // a size set within the notice would call for another
  return h("figure", { class: "chart" }, h("figcaption", {}, h("strong", {}, chart.title), h("span", {}, chart.remark)), place, valuesOf(chart));
}

function valuesOf(chart: Chart): HTMLElement {
  const rows = chart.x.map((x, i) => h("tr", {}, h("th", { scope: "row" }, figure(x, 4)), ...chart.lines.map((line) => h("td", { class: "number" }, figure(line.y[i], 5)))));
  const head = h("tr", {}, h("th", { scope: "col" }, chart.x_name), ...chart.lines.map((line) => h("th", { scope: "col" }, line.name)));
  return h("details", {}, h("summary", {}, "values"), h("div", { class: "scroll" }, h("table", {}, h("thead", {}, head), h("tbody", {}, ...rows))));
}

/** Bars over a linear or logarithmic axis. */
export function histogramOf(histogram: Histogram): HTMLElement {
  const [width, height, left, bottom, top] = [600, 230, 26, 36, 14];
  const { edges, counts, is_logarithmic, mark } = histogram;
  const on = (value: number) => (is_logarithmic ? Math.log10(value) : value);
  let [low, high] = [on(edges[0]), on(edges[edges.length - 1])];
  if (mark && mark > 0) [low, high] = [Math.min(low, on(mark)), Math.max(high, on(mark))];
  const x = (value: number) => left + ((on(value) - low) / (high - low || 1)) * (width - 2 * left);
  const most = Math.max(...counts, 1);
  const bars = counts.map((many, i) => s("rect", {
    x: x(edges[i]).toFixed(1), width: Math.max(0.8, x(edges[i + 1]) - x(edges[i]) - 0.8).toFixed(1), class: "bar-fill",
    y: (height - bottom - (many / most) * (height - bottom - top)).toFixed(1), height: ((many / most) * (height - bottom - top)).toFixed(1),
  }, s("title", {}, `${figure(edges[i])} to ${figure(edges[i + 1])} ${histogram.unit}: ${count(many)} rows`)));
  const ticks = ticksOf(low, high, is_logarithmic).map((value, _, all) => s("text", { x: x(value).toFixed(1), y: height - 18, class: "tick", "text-anchor": "middle" }, figure(value, digitsFor(all))));
  const total = counts.reduce((sum, many) => sum + many, 0);
  const line = mark && mark > 0 ? [
    s("line", { x1: x(mark), x2: x(mark), y1: top - 4, y2: height - bottom, class: "mark" }),
    s("text", { x: x(mark) + (x(mark) > width / 2 ? -5 : 5), y: top + 8, class: "tick", "text-anchor": x(mark) > width / 2 ? "end" : "start" }, `${histogram.mark_name}: ${figure(mark)} ${histogram.unit}`),
  ] : [];
  const words = `${histogram.title}: ${count(total)} rows from ${figure(edges[0])} to ${figure(edges[edges.length - 1])} ${histogram.unit}`;
  return h("figure", { class: "chart" }, h("figcaption", {}, h("strong", {}, histogram.title), h("span", {}, `${count(total)} rows`)),
    s("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": words },
      s("line", { x1: left, x2: width - left, y1: height - bottom, y2: height - bottom, class: "axis" }), ...bars, ...line, ...ticks,
      s("text", { x: width / 2, y: height - 3, class: "tick", "text-anchor": "middle" }, histogram.unit)), binsOf(histogram));
}

/** The counts of a histogram as a table; empty bins are left out. */
function binsOf({ edges, counts, unit }: Histogram): HTMLElement {
  const rows = counts.flatMap((many, i) => (many ? [h("tr", {}, h("td", { class: "number" }, figure(edges[i], 4)), h("td", { class: "number" }, figure(edges[i + 1], 4)), h("td", { class: "number" }, count(many)))] : []));
  const head = h("tr", {}, ...[`from ${unit}`, `to ${unit}`, "rows"].map((name) => h("th", { scope: "col", class: "number" }, name)));
  return h("details", {}, h("summary", {}, "values"), h("div", { class: "scroll tall" }, h("table", {}, h("thead", {}, head), h("tbody", {}, ...rows))));
}

function ticksOf(low: number, high: number, isLogarithmic: boolean): number[] {
  if (isLogarithmic && high - low > 1.2) {
    const step = Math.max(1, Math.ceil((high - low) / 6));
    return Array.from({ length: 12 }, (_, i) => Math.ceil(low) + i * step).filter((power) => power <= high).map((power) => 10 ** power);
  }
  const [start, end] = isLogarithmic ? [10 ** low, 10 ** high] : [low, high];
  const step = niceStep((end - start) / 7);
  return Array.from({ length: 9 }, (_, i) => (Math.ceil(start / step) + i) * step).filter((value) => value <= end * (1 + 1e-9));
}

/** Significant digits with which neighbouring ticks read differently. */
function digitsFor(ticks: number[]): number {
  const apart = ticks.length > 1 ? Math.abs(ticks[1] - ticks[0]) : 1;
  return Math.max(1, Math.ceil(Math.log10(Math.max(...ticks.map(Math.abs), apart) / apart) + 1e-9) + 1);
}

function niceStep(rough: number): number {
  const power = 10 ** Math.floor(Math.log10(rough || 1));
  return [1, 2, 5, 10].map((one) => one * power).find((one) => one >= rough) ?? 10 * power;
}

/** Spots as a grid: a row per distance, a column per place, all at one scale, with the square of a pixel. */
export function spotsOf(spots: Spot[]): HTMLElement {
  const distances = [...new Set(spots.map((one) => one.distance_mm))];
  const places = [...new Set(spots.map((one) => one.place))];
  const reach = 1.15 * Math.max(0.6, ...spots.flatMap((one) => [...one.dx_px, ...one.dy_px].map((value) => Math.abs(value ?? 0))));
  const find = (distance: number, place: string) => spots.find((one) => one.distance_mm === distance && one.place === place)!;
  const names = ["near end of the depth of field", "in focus", "far end of the depth of field"];
  const head = h("tr", {}, h("th", { scope: "col" }, "distance"), ...places.map((place) => {
    const one = find(distances[0], place);
    return h("th", { scope: "col" }, place, h("small", {}, `(${figure(one.x_px, 5)}, ${figure(one.y_px, 5)}) px`));
  }));
  const rows = distances.map((distance, i) => h("tr", {},
    h("th", { scope: "row" }, `${figure(distance, 6)} mm`, h("small", {}, names[i] ?? "")),
    ...places.map((place) => h("td", {}, spotOf(find(distance, place), reach)))));
  return h("div", { class: "scroll" }, h("table", { class: "spots" }, h("thead", {}, head), h("tbody", {}, ...rows)));
}

function spotOf(spot: Spot, reach: number): HTMLElement {
  const size = 120, at = (value: number | null) => size / 2 + ((value ?? 0) / reach) * (size / 2);
  const dots = spot.dx_px.map((dx, i) => s("circle", { cx: at(dx).toFixed(1), cy: at(spot.dy_px[i]).toFixed(1), r: 1.1, class: "dot" }));
  const half = size / 2 / reach / 2;
  const square = s("rect", { x: size / 2 - half, y: size / 2 - half, width: 2 * half, height: 2 * half, class: "pixel" });
  const words = spot.dx_px.length ? `${measured(spot.rms_px)} px rms` : "no light";
  return h("div", { class: "spot" }, s("svg", { viewBox: `0 0 ${size} ${size}`, role: "img", "aria-label": `spot at ${spot.place}, ${figure(spot.distance_mm)} mm: ${words}` }, square, ...dots), h("small", {}, words));
}

/** Where the points lie on the sensor, coloured by signed blur, with what the pinhole leaves as arrows. */
export function mapOf(residuals: Residuals, width: number, height: number): HTMLElement {
  const found = residuals.dx_px.flatMap((dx, i) => (dx === null ? [] : [Math.hypot(dx, residuals.dy_px[i]!)])).sort((a, b) => a - b);
  const longest = found[Math.floor(0.98 * (found.length - 1))] ?? 0;
  const enlarged = longest > 0 ? 10 ** Math.floor(Math.log10((0.06 * width) / longest)) : 0;
  const blurs = residuals.rho_px.map((rho) => Math.abs(rho ?? 0)).sort((a, b) => a - b);
  const most = blurs[Math.floor(0.95 * (blurs.length - 1))] || 1;
  const radius = Math.max(width, height) / 260;
  const dots = residuals.x_px.map((x, i) => s("circle", { cx: x!, cy: residuals.y_px[i]!, r: radius, fill: diverging((residuals.rho_px[i] ?? 0) / most) }));
  const arrows = enlarged ? residuals.dx_px.map((dx, i) => s("line", {
    x1: residuals.x_px[i]!, y1: residuals.y_px[i]!, x2: residuals.x_px[i]! + enlarged * (dx ?? 0), y2: residuals.y_px[i]! + enlarged * (residuals.dy_px[i] ?? 0), class: "arrow", "stroke-width": radius / 2.2,
  })) : [];
  const remark = `blue: before best focus, red: beyond, full colour at ${figure(most)} px${enlarged ? `; arrows: position minus pinhole with distortion, ${count(enlarged)} times enlarged` : ""}`;
  return h("figure", { class: "chart map" }, h("figcaption", {}, h("strong", {}, "Points on the sensor, all frames"), h("span", {}, remark)),
    s("svg", { viewBox: `-0.5 -0.5 ${width} ${height}`, role: "img", "aria-label": `map of ${count(dots.length)} points; ${remark}`, style: `max-height: 420px` },
      s("rect", { x: -0.5, y: -0.5, width, height, class: "sensor" }), ...dots, ...arrows));
}

function diverging(value: number): string {
  const t = Math.max(-1, Math.min(1, value));
  const mix = (a: number[], b: number[], share: number) => a.map((one, i) => Math.round(one + (b[i] - one) * share));
  const grey = [150, 156, 166];
  return `rgb(${(t < 0 ? mix(grey, [34, 98, 220], -t) : mix(grey, [220, 52, 40], t)).join(",")})`;
}
