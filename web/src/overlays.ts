// What is drawn over an image: truth points, blur ellipses, outlines of micro-images, their lattice, the pixel grid.
// (0, 0) is the centre of the top-left pixel; the canvas gets a transform from there to the screen.

import { colour } from "./dom";
import type { MicroImageData } from "./records";
import type { Rows } from "./rows";

export interface Place {
  /** Screen position of (0, 0), and screen pixels per image pixel. */
  x: number;
  y: number;
  scale: number;
  width: number;
  height: number;
}

export const TYPES = ["#f07818", "#2f86ee", "#e0479e", "#2fa866", "#8f63e8", "#c8a016"];

export const LAYERS = [
  { name: "Points", key: "1", on: true },
  { name: "Blur", key: "2", on: false },
  { name: "Outlines", key: "3", on: false },
  { name: "Lattice", key: "4", on: false },
  { name: "Ids", key: "5", on: false },
  { name: "Pixels", key: "6", on: false },
];

type Pen = CanvasRenderingContext2D;

/** Draws the layers that are on; `chosen` is the row that is pointed at. */
export function draw(
  pen: Pen, place: Place, on: Set<string>, rows: Rows | null, images: MicroImageData | null, chosen: number | null,
): void {
  if (on.has("Pixels")) pixels(pen, place);
  if (images && on.has("Lattice")) lattice(pen, place, images);
  if (images && on.has("Outlines")) outlines(pen, place, images);
  if (!rows) return;
  if (on.has("Blur")) blur(pen, place, rows);
  if (on.has("Points")) points(pen, place, rows, on.has("Ids"));
  if (chosen !== null && chosen < rows.length) mark(pen, place, rows, chosen);
}

/** Colour of a row: of its type of microlens, or orange. */
export function colourOf(rows: Rows, row: number): string {
  const type = rows.cell("microlens_type", row);
  return TYPES[(typeof type === "number" ? type : 0) % TYPES.length];
}

function seen(place: Place, x: number, y: number, margin: number): boolean {
  return x > -margin && y > -margin && x < place.width + margin && y < place.height + margin;
}

function points(pen: Pen, place: Place, rows: Rows, named: boolean): void {
  const arm = Math.min(9, Math.max(3, 2.5 * Math.sqrt(place.scale)));
  const byColour = new Map<string, Path2D>();
  const words: [string, number, number][] = [];
  for (let row = 0; row < rows.length; row++) {
    const x = place.x + rows.number("x_px", row) * place.scale;
    const y = place.y + rows.number("y_px", row) * place.scale;
    if (!seen(place, x, y, arm)) continue;
    const key = colourOf(rows, row);
    const path = byColour.get(key) ?? new Path2D();
    byColour.set(key, path);
    path.moveTo(x - arm, y);
    path.lineTo(x + arm, y);
    path.moveTo(x, y - arm);
    path.lineTo(x, y + arm);
    if (named && words.length < 800) words.push([String(rows.cell("point_id", row)), x + arm + 1, y - 3]);
  }
  pen.lineCap = "round";
  for (const [width, tint] of [[3.6, "rgba(0,0,0,.55)"], [1.6, null]] as const)
    for (const [key, path] of byColour) {
      pen.lineWidth = width;
      pen.strokeStyle = tint ?? key;
      pen.stroke(path);
    }
  pen.font = "600 11px system-ui, sans-serif";
  for (const [word, x, y] of words) {
    pen.lineWidth = 3;
    pen.strokeStyle = "rgba(0,0,0,.7)";
    pen.strokeText(word, x, y);
    pen.fillStyle = "#fff";
    pen.fillText(word, x, y);
  }
}

/** Axes and angle of the disc that has a covariance: two standard deviations, the rim of an even disc. */
export function ellipse(xx: number, xy: number, yy: number): { a: number; b: number; angle: number } {
  const middle = (xx + yy) / 2;
  const apart = Math.hypot((xx - yy) / 2, xy);
  return {
    a: 2 * Math.sqrt(Math.max(0, middle + apart)),
    b: 2 * Math.sqrt(Math.max(0, middle - apart)),
    angle: 0.5 * Math.atan2(2 * xy, xx - yy),
  };
}

function blur(pen: Pen, place: Place, rows: Rows): void {
  for (let row = 0; row < rows.length; row++) {
    const x = place.x + rows.number("x_px", row) * place.scale;
    const y = place.y + rows.number("y_px", row) * place.scale;
    const disc = ellipse(rows.number("blur_xx_px2", row), rows.number("blur_xy_px2", row), rows.number("blur_yy_px2", row));
    const reach = disc.a * place.scale;
    if (!Number.isFinite(reach) || reach < 0.7 || !seen(place, x, y, reach)) continue;
    pen.beginPath();
    pen.ellipse(x, y, reach, Math.max(disc.b * place.scale, 0.4), disc.angle, 0, 2 * Math.PI);
    pen.fillStyle = "rgba(255, 214, 74, .16)";
    pen.fill();
    pen.lineWidth = 1.3;
    pen.strokeStyle = "#ffd23f";
    pen.stroke();
  }
}

function outlines(pen: Pen, place: Place, images: MicroImageData): void {
  if (place.scale < 0.35) return;
  pen.lineWidth = Math.min(1.6, 0.5 + 0.3 * place.scale);
  images.outline_radius_px.forEach((radii, i) => {
    const x = place.x + (images.outline_x_px[i] ?? NaN) * place.scale;
    const y = place.y + (images.outline_y_px[i] ?? NaN) * place.scale;
    if (!seen(place, x, y, 60 * place.scale)) return;
    pen.beginPath();
    radii.forEach((radius, step) => {
      const angle = (2 * Math.PI * step) / radii.length;
      const reach = (radius ?? 0) * place.scale;
      pen.lineTo(x + reach * Math.cos(angle), y + reach * Math.sin(angle));
    });
    pen.closePath();
    pen.strokeStyle = TYPES[images.type[i] % TYPES.length];
    pen.stroke();
  });
}

/** Lines between the centres of neighbours along the axes of the lattice, and the centres. */
function lattice(pen: Pen, place: Place, images: MicroImageData): void {
  if (place.scale < 0.35) return;
  const at = new Map(images.k.map((k, i) => [`${k},${images.l[i]}`, i]));
  const spot = (i: number): [number, number] => [
    place.x + (images.centre_x_px[i] ?? NaN) * place.scale,
    place.y + (images.centre_y_px[i] ?? NaN) * place.scale,
  ];
  pen.lineWidth = 0.8;
  pen.strokeStyle = "rgba(70, 200, 220, .75)";
  pen.beginPath();
  images.k.forEach((k, i) => {
    const [x, y] = spot(i);
    if (!seen(place, x, y, 60 * place.scale)) return;
    for (const [dk, dl] of [[1, 0], [0, 1]]) {
      const next = at.get(`${k + dk},${images.l[i] + dl}`);
      if (next === undefined) continue;
      pen.moveTo(x, y);
      pen.lineTo(...spot(next));
    }
    pen.moveTo(x + 2, y);
    pen.arc(x, y, 2, 0, 2 * Math.PI);
  });
  pen.stroke();
}

function pixels(pen: Pen, place: Place): void {
  if (place.scale < 8) return;
  pen.lineWidth = 0.5;
  pen.strokeStyle = "rgba(128, 128, 128, .6)";
  pen.beginPath();
  const first = (start: number) => start + (Math.ceil((-start) / place.scale + 0.5) - 0.5) * place.scale;
  for (let x = first(place.x); x < place.width; x += place.scale) {
    pen.moveTo(x, 0);
    pen.lineTo(x, place.height);
  }
  for (let y = first(place.y); y < place.height; y += place.scale) {
    pen.moveTo(0, y);
    pen.lineTo(place.width, y);
  }
  pen.stroke();
}

function mark(pen: Pen, place: Place, rows: Rows, row: number): void {
  const x = place.x + rows.number("x_px", row) * place.scale;
  const y = place.y + rows.number("y_px", row) * place.scale;
  pen.beginPath();
  pen.arc(x, y, 13, 0, 2 * Math.PI);
  pen.lineWidth = 5;
  pen.strokeStyle = "rgba(0,0,0,.5)";
  pen.stroke();
  pen.lineWidth = 2.2;
  pen.strokeStyle = colour("focus") || "#fff";
  pen.stroke();
}
