// Data of the page: scripts that call `plenopticReport` with their name and content, loaded when they are looked at.
// A page from disk may load scripts, and nothing else.

const held = new Map<string, Promise<unknown>>();
const waiting = new Map<string, (content: unknown) => void>();

declare global {
  interface Window {
    plenopticReport: (name: string, content: unknown) => void;
  }
}

window.plenopticReport = (name, content) => {
  waiting.get(name)?.(content);
  waiting.delete(name);
};

/** Content of a script, e.g. `data/page.js`; it is loaded once. */
export function load<T>(path: string): Promise<T> {
  const found = held.get(path);
  if (found) return found as Promise<T>;
  const name = path.replace(/^data\//, "").replace(/\.js$/, "");
  const coming = new Promise<unknown>((resolve, reject) => {
    waiting.set(name, resolve);
    const script = document.createElement("script");
    script.src = path.split("/").map(encodeURIComponent).join("/");
    script.onerror = () => reject(new Error(`${path} is missing: write the report again`));
    document.head.append(script);
  });
  held.set(path, coming);
  return coming as Promise<T>;
}
