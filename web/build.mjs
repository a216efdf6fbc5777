// Bundles the page into the package: npm ci && node build.mjs. `make web` does both.
//
// The digest of all sources stands in the first line of the bundle, so that a test on a machine without npm can tell
// whether the bundle that is committed is that of the sources that are committed.

import { createHash } from "node:crypto";
import { readdirSync, readFileSync, writeFileSync } from "node:fs";
import { build } from "esbuild";

const place = "../pipeline/plugins/report/assets";
const names = [...readdirSync("src").map((name) => `src/${name}`), "package.json", "package-lock.json", "build.mjs"].sort();
const digest = createHash("sha256");
for (const name of names) digest.update(`${name}\0`).update(readFileSync(name)).update("\0");
const head = `/* plenoptic-pipeline report, sources ${digest.digest("hex")}; three.js, OpenSeadragon, uPlot: see LICENSES.txt */`;

const shared = { bundle: true, minify: true, legalComments: "none", logLevel: "warning", target: "es2022", charset: "utf8" };
const styles = `${readFileSync("node_modules/uplot/dist/uPlot.min.css", "utf8")}\n`;
await build({ ...shared, entryPoints: ["src/main.ts"], format: "iife", outfile: `${place}/report.js`, banner: { js: head } });
await build({ ...shared, entryPoints: ["src/report.css"], outfile: `${place}/report.css`, banner: { css: `${head}\n${styles}` } });
writeFileSync(`${place}/index.html`, readFileSync("src/index.html"));

const libraries = [["three.js", "three/LICENSE"], ["OpenSeadragon", "openseadragon/LICENSE.txt"], ["uPlot", "uplot/LICENSE"]];
const texts = libraries.map(([name, file]) => {
  const { version } = JSON.parse(readFileSync(`node_modules/${file.split("/")[0]}/package.json`, "utf8"));
  return `${name} ${version}\n${"=".repeat(name.length + version.length + 1)}\n\n${readFileSync(`node_modules/${file}`, "utf8").trim()}\n`;
});
writeFileSync(`${place}/LICENSES.txt`, texts.join("\n\n"));
