// Texts of the page whose contrast is below 4.5 to 1, by WCAG 2: where they are, and their ratio.
(() => {
  const colour = (text) => {
    const parts = text.match(/[\d.]+/g).map(Number), scale = text.startsWith("color(") ? 255 : 1;
    return [parts[0] * scale, parts[1] * scale, parts[2] * scale, parts[3] ?? 1];
  };
  const over = (above, below) => above.slice(0, 3).map((one, i) => one * above[3] + below[i] * (1 - above[3]));
  const behind = (element) => {
    const layers = [];
    for (let at = element; at; at = at.parentElement) {
      layers.push(colour(getComputedStyle(at).backgroundColor));
      if (layers.at(-1)[3] === 1) break;
    }
    return layers.reverse().reduce((below, above) => over(above, below), [255, 255, 255]);
  };
  const luminance = (rgb) => {
    const linear = rgb.map((one) => (one / 255 <= 0.04045 ? one / 255 / 12.92 : ((one / 255 + 0.055) / 1.055) ** 2.4));
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
  };
  const found = {}, words = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let word = words.nextNode(); word; word = words.nextNode()) {
    const element = word.parentElement;
    if (!word.textContent.trim() || !element.getClientRects().length) continue;
    if (element.closest("svg, script, .viewer-stage, [aria-hidden]")) continue;
    const back = behind(element), text = over(colour(getComputedStyle(element).color), back);
    const [bright, dark] = [luminance(text), luminance(back)].sort((a, b) => b - a);
    const ratio = (bright + 0.05) / (dark + 0.05);
    if (ratio < 4.5) found[`${element.tagName}.${element.className}`] = ratio;
  }
  return found;
})()
