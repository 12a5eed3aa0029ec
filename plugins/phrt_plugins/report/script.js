"use strict";

// Tables: a click on a heading sorts by its column, a second one the other way round. What has no value stays last.
for (const table of document.querySelectorAll("table.sortable")) {
  const headings = [...table.tHead.rows[0].cells];
  headings.forEach((heading, column) => {
    heading.querySelector("button").addEventListener("click", () => {
      const falling = heading.getAttribute("aria-sort") === "ascending";
      headings.forEach((other) => other.removeAttribute("aria-sort"));
      heading.setAttribute("aria-sort", falling ? "descending" : "ascending");
      const value = (row) => row.cells[column].dataset.sort;
      const compare = (a, b) => {
        const [x, y] = [value(a), value(b)];
        if (x === "" || y === "") return (x === "") - (y === "");
        const [p, q] = [Number(x), Number(y)];
        const order = Number.isNaN(p) || Number.isNaN(q) ? x.localeCompare(y, undefined, { numeric: true }) : p - q;
        return falling ? -order : order;
      };
      table.tBodies[0].append(...[...table.tBodies[0].rows].sort(compare));
    });
  });
}

// Downloads: a figure's SVG is the one that is shown, at the size it was drawn for.
for (const link of document.querySelectorAll("a.svg")) {
  const svg = link.closest("figure").querySelector("svg").cloneNode(true);
  const [, , width, height] = svg.getAttribute("viewBox").split(" ");
  svg.setAttribute("width", `${width}pt`);
  svg.setAttribute("height", `${height}pt`);
  const text = new XMLSerializer().serializeToString(svg);
  link.href = "data:image/svg+xml;charset=utf-8," + encodeURIComponent(text);
}

// Pictures: two of one frame with a slider between them.
for (const viewer of document.querySelectorAll(".viewer")) {
  const find = (selector) => viewer.querySelector(selector);
  const [frame, left, right, errors, slider] = [".frame", ".left", ".right", ".errors", ".slider"].map(find);
  const [under, over, handle] = [".under", ".over", ".handle"].map(find);
  const groups = [...viewer.querySelectorAll(".shots")];
  const group = () => groups.find((each) => each.dataset.frame === frame.value);
  const shot = (name) => [...group().children].find((each) => each.dataset.name === name);

  const fill = (select, fallback) => {
    const before = select.value;
    const names = [...group().children].map((each) => each.dataset.name).filter((name) => name !== undefined);
    select.replaceChildren(...names.map((name) => new Option(name, name)));
    select.value = names.includes(before) ? before : names[Math.min(fallback, names.length - 1)];
  };
  // The first contestant that differs from the reference, which has raster only behind it.
  const differing = () => {
    const shots = [...group().children].filter((each) => each.dataset.name !== undefined);
    return Math.max(shots.findIndex((each, number) => number >= 2 && Number(each.dataset.flip) > 0), Math.min(2, shots.length - 1));
  };
  const put = (image, name, wantsMap) => {
    const found = shot(name);
    const map = found.querySelector(".map");
    const source = wantsMap && map ? map : found.querySelector(".picture");
    image.src = source.src;
    image.alt = source.alt;
    return wantsMap && !map && found !== shot(left.options[0].value) ? `${name} (no map)` : name + (source === map ? ", FLIP map" : "");
  };
  const show = () => {
    groups.forEach((each) => (each.hidden = each !== group()));
    find(".of-left").textContent = put(under, left.value, false);
    find(".of-right").textContent = put(over, right.value, errors.checked);
    for (const button of viewer.querySelectorAll(".shots button")) {
      button.setAttribute("aria-pressed", String(button.parentElement.dataset.name === right.value));
    }
  };
  const slide = () => {
    over.style.clipPath = `inset(0 0 0 ${slider.value}%)`;
    handle.style.left = `${slider.value}%`;
    slider.setAttribute("aria-valuetext", `${slider.value} % ${left.value}, the rest ${right.value}`);
  };
  const change = () => {
    fill(left, 0);
    fill(right, differing());
    show();
    slide();
  };
  frame.addEventListener("change", change);
  for (const control of [left, right, errors]) control.addEventListener("change", () => { show(); slide(); });
  slider.addEventListener("input", slide);
  viewer.addEventListener("click", (event) => {
    const button = event.target.closest(".shots button");
    if (!button) return;
    right.value = button.parentElement.dataset.name;
    show();
    slide();
  });
  frame.selectedIndex = Math.floor((frame.options.length - 1) / 2);
  change();
}

// On paper everything is open.
window.addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((each) => (each.open = true)));
