// Rows of a table of correspondences, by column as the page carries them.

import { load } from "./data";
import type { TableData } from "./records";

/** A table with access by row. */
export class Rows {
  readonly names: string[];
  readonly length: number;

  constructor(private table: TableData) {
    this.length = table.rows;
    this.names = [...Object.keys(table.same), ...Object.keys(table.columns)];
  }

  /** A cell; null where the table has none. */
  cell(name: string, row: number): number | string | null {
    return name in this.table.same ? this.table.same[name] : (this.table.columns[name]?.[row] ?? null);
  }

  number(name: string, row: number): number {
    return (this.cell(name, row) as number | null) ?? NaN;
  }

  /** Cells of a row, in the order of the table as it is on disk. */
  row(row: number): [string, number | string | null][] {
    return ORDER.concat(this.names.filter((name) => !ORDER.includes(name)))
      .filter((name) => this.names.includes(name))
      .map((name) => [name, this.cell(name, row)]);
  }
}

const ORDER = [
  "target", "point_id", "microlens_k", "microlens_l", "microlens_type", "x_px", "y_px", "sigma_x_px", "sigma_y_px",
  "rho_px", "hit_fraction", "visibility", "method", "frame", "camera", "channel",
];

export async function rowsOf(path: string): Promise<Rows> {
  return new Rows(await load<TableData>(path));
}
