// Written by web/record_types.py from pipeline/plugins/report/records.py: edit that.

/** A row of the page of `pipeline show`. */
export interface Figure {
  name: string;
  value: string;
  remark: string;
}

/** Some rows with a heading. */
export interface Figures {
  heading: string;
  rows: Figure[];
}

/** Real rays of one sensor position, each a polyline from the sensor into the scene, vision frame [mm]. */
export interface RayFan {
  place: string;
  rays: [number, number, number][][];
}

/** A surface of the lens for the 3-D view, vision frame. */
export interface SurfaceShape {
  height_mm: number[];
  z_mm: number[];
  has_glass_behind: boolean;
  is_stop: boolean;
  moved: number[][];
}

/** Intersections of a bundle with an object plane, as displacements of the image of their mean [px]. */
export interface Spot {
  place: string;
  x_px: number;
  y_px: number;
  distance_mm: number;
  dx_px: (number | null)[];
  dy_px: (number | null)[];
  rms_px: number | null;
}

/** An image for the viewer. */
export interface Picture {
  kind: string;
  width_px: number;
  height_px: number;
  path: string;
  tile_px: number | null;
  levels: number;
  section: string;
}

/** A camera in a frame; `data` is the script with its table. */
export interface View {
  frame: number;
  rows: number;
  seen: number;
  of: number;
  data: string;
  pictures: Picture[];
  camera_from_world: number[][];
  camera_from_target: Record<string, number[][]>;
}

/** The rows of a table by column; `same` holds the constant columns. */
export interface TableData {
  rows: number;
  same: Record<string, any>;
  columns: Record<string, any[]>;
}

/** Micro-images of a camera; radii of outlines are from the centroid, in equal steps from +x towards +y. */
export interface MicroImageData {
  k: number[];
  l: number[];
  type: number[];
  centre_x_px: (number | null)[];
  centre_y_px: (number | null)[];
  outline_x_px: (number | null)[];
  outline_y_px: (number | null)[];
  outline_radius_px: ((number | null)[])[];
}

/** Counts between edges (one more than counts); `unit` belongs to the edges. */
export interface Histogram {
  title: string;
  unit: string;
  is_logarithmic: boolean;
  edges: number[];
  counts: number[];
  mark: number | null;
  mark_name: string;
}

/** Statistics of all rows of a camera; points are an even selection of at most a few thousand. */
export interface Residuals {
  histograms: Histogram[];
  x_px: (number | null)[];
  y_px: (number | null)[];
  rho_px: (number | null)[];
  dx_px: (number | null)[];
  dy_px: (number | null)[];
}

/** A curve of a chart. */
export interface Line {
  name: string;
  y: (number | null)[];
  is_dashed: boolean;
}

/** Curves over a common axis. */
export interface Chart {
  title: string;
  remark: string;
  x_name: string;
  y_name: string;
  x: (number | null)[];
  lines: Line[];
  y_range: [number, number] | null;
}

/** The optical part of a camera. */
export interface Optics {
  drawing: string;
  figures: Figures[];
  charts: Chart[];
  spots: Spot[];
  surfaces: SurfaceShape[];
  sensor_mm: number[][];
  fans: RayFan[];
}

/** A section of the page that another plug-in tells of a camera: lines, and an SVG, empty where there is none. */
export interface ToldPart {
  lines: string[];
  drawing: string;
}

/** A camera, or one of its channels; `optics` and so on are scripts, None where there are none, and those of */
export interface CameraPart {
  name: string;
  kind: string;
  lens: string;
  width_px: number;
  height_px: number;
  principal_distance_px: number;
  certificate: Record<string, any> | null;
  optics: string | null;
  micro_images: string | null;
  told: Record<string, string>;
  pictures: Picture[];
  views: View[];
  residuals: Residuals;
}

/** A target: faces as quadrilaterals in the target frame, and their corners on its picture. */
export interface TargetPart {
  name: string;
  kind: string;
  points: number;
  corners_mm: number[][];
  faces: number[][];
  places: number[][];
  picture: string;
}

/** A task: how it ended in the last build, and the run that made its result. */
export interface TaskRun {
  name: string;
  kind: string;
  state: string;
  start_s: number | null;
  end_s: number | null;
  cpu_s: number | null;
  peak_bytes: number | null;
}

/** History of the folder: its tasks. */
export interface History {
  tasks: TaskRun[];
  seconds: number | null;
  workers: number | null;
}

/** Everything that the page shows at once; the rest are scripts that it loads on demand. */
export interface Page {
  title: string;
  stage: string;
  seed: number;
  frames: number[];
  bytes: number;
  files: number;
  versions: Record<string, string>;
  cameras: CameraPart[];
  targets: TargetPart[];
  history: string;
}
