// Values under the pointer, read back from the drawn curves; the page is complete without it.
"use strict";
const tip = document.getElementById("tip");
let cursor = null;

function points(group) {
  const path = group.querySelector("path[d]:not(defs path)");
  if (path && !group.querySelector("use")) {
    return [...path.getAttribute("d").matchAll(/[ML]\s*([-\d.]+)[ ,]([-\d.]+)/g)].map(m => [+m[1], +m[2]]);
  }
  return [...group.querySelectorAll("use")].map(use => [+use.getAttribute("x"), +use.getAttribute("y")]);
}

function hide() {
  tip.hidden = true;
  if (cursor) { cursor.remove(); cursor = null; }
}

function show(svg, plot, event) {
  const frame = svg.getBoundingClientRect();
  const scale = svg.viewBox.baseVal.width / frame.width;
  const at = (event.clientX - frame.left) * scale;
  const [left, top, right, bottom] = [plot.area[0], plot.area[3], plot.area[2], plot.area[1]];
  if (at < left || at > right) { hide(); return; }
  const value = (position, from, to, span) => span[0] + (position - from) / (to - from) * (span[1] - span[0]);
  svg.series ??= [...svg.querySelectorAll('g[id*="-series-"]')].map(group =>
    ({name: group.id.split("-series-")[1], points: points(group)}));
  let x = null;
  const lines = svg.series.filter(series => series.points.length).map(series => {
    const nearest = series.points.reduce((a, b) => Math.abs(b[0] - at) < Math.abs(a[0] - at) ? b : a);
    x ??= nearest[0];
    const height = value(nearest[1], bottom, top, plot.y);
    return `${series.name}  ${(plot.log ? 10 ** height : height).toPrecision(4)}`;
  });
  if (x === null) { return; }
  if (!cursor || cursor.ownerSVGElement !== svg) {
    hide();
    cursor = document.createElementNS(svg.namespaceURI, "line");
    cursor.setAttribute("class", "cursor");
    svg.append(cursor);
  }
  for (const [name, to] of [["x1", x], ["x2", x], ["y1", top], ["y2", bottom]]) { cursor.setAttribute(name, to); }
  tip.textContent = `at ${+value(x, left, right, plot.x).toPrecision(5)}\n${lines.join("\n")}`;
  tip.hidden = false;
  const wide = document.documentElement.clientWidth;
  tip.style.left = `${Math.max(4, Math.min(event.clientX + 14, wide - tip.offsetWidth - 8)) + scrollX}px`;
  tip.style.top = `${frame.top + scrollY - tip.offsetHeight - 4}px`;
}

for (const svg of document.querySelectorAll("svg[data-plot]")) {
  const plot = JSON.parse(svg.dataset.plot);
  if (!plot.area) { continue; }
  svg.addEventListener("pointermove", event => show(svg, plot, event));
  svg.addEventListener("pointerdown", event => show(svg, plot, event));
  svg.addEventListener("pointerleave", hide);
}
