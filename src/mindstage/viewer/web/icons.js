// Icons as stroked SVG paths in a 16 x 16 view box.

const PATHS = {
  play: "M5 3l8 5-8 5z",
  pause: "M5 3v10M11 3v10",
  step: "M4 3l6 5-6 5zM12 3v10",
  previousEvent: "M12 3l-6 5 6 5zM4 3v10",
  nextEvent: "M4 3l6 5-6 5zM12 3v10",
  record: "M8 4a4 4 0 1 0 0 8 4 4 0 0 0 0-8",
  reset: "M3 8a5 5 0 1 0 1.6-3.7M3 2.5v3h3",
  undo: "M6 3L3 6l3 3M3 6h6a4 4 0 0 1 0 8H6",
  redo: "M10 3l3 3-3 3M13 6H7a4 4 0 0 0 0 8h3",
  home: "M2.5 8L8 3l5.5 5M4 7v6h8V7",
  top: "M3 3h10v10H3zM3 8h10M8 3v10",
  focus: "M2 5V2h3M11 2h3v3M14 11v3h-3M5 14H2v-3M8 6a2 2 0 1 0 0 4 2 2 0 0 0 0-4",
  clip: "M2 9h12M4 9v4h8V9M4 6V3h8v3",
  label: "M2 4h8l4 4-4 4H2zM5 8h3",
  translate: "M8 1v14M1 8h14M6 3l2-2 2 2M6 13l2 2 2-2M3 6L1 8l2 2M13 6l2 2-2 2",
  rotate: "M13 8a5 5 0 1 1-1.6-3.7M13 2v3h-3",
  save: "M8 2v8M5 7l3 3 3-3M3 13h10",
  open: "M8 10V2M5 5l3-3 3 3M3 13h10",
  trash: "M3 4h10M6 4V2.5h4V4M4.5 4l.6 9.5h5.8l.6-9.5",
  link: "M6.5 9.5l3-3M7 4.5l1.5-1.5a2.5 2.5 0 0 1 3.6 3.6L10.500 8M9 11.500l-1.500 1.500A2.500 2.500 0 0 1 3.900 9.400L5.500 8",
  unlink: "M7 4.500l1.500-1.500a2.500 2.500 0 0 1 3.600 3.600L10.500 8M9 11.500l-1.500 1.500A2.500 2.500 0 0 1 3.900 9.400L5.500 8M3 3l10 10",
  eye: "M1.500 8S4 3.800 8 3.800 14.500 8 14.500 8 12 12.200 8 12.200 1.500 8 1.500 8zM8 6.200a1.800 1.800 0 1 0 0 3.600 1.800 1.800 0 0 0 0-3.600",
  hidden: "M1.500 8S4 3.800 8 3.800 14.500 8 14.500 8 12 12.200 8 12.200 1.500 8 1.500 8zM3 13L13 3",
  chevronRight: "M6 4l4 4-4 4",
  chevronDown: "M4 6l4 4 4-4",
  joint: "M3 13V8h5M8 8a2 2 0 1 0 4-.5M8 8a2 2 0 0 1 4-.5M12 3v3",
  close: "M4 4l8 8M12 4l-8 8",
  search: "M7 2.500a4.500 4.500 0 1 0 0 9 4.500 4.500 0 0 0 0-9M10.500 10.500L14 14",
  help: "M5.500 6a2.500 2.500 0 1 1 3.600 2.200c-.8.4-1.100.9-1.100 1.800M8 12.800v.4",
  measure: "M2 11L11 2l3 3-9 9zM5 8l1.500 1.500M7 6l2 2M9 4l1.500 1.500",
  box: "M8 2l5.500 3v6L8 14l-5.500-3V5zM2.500 5L8 8l5.500-3M8 8v6",
  inside: "M2 3v10h12V3M6 3.500h4v5.500H6z",
  onTop: "M2 12h12M5.500 5.500h5v6h-5z",
  room: "M2.500 13.500v-11h11v11M2.500 13.500h5M10.500 13.500h3M7.500 13.500a3 3 0 0 1 3-3v3",
  more: "M3 4h10M3 8h10M3 12h10",
};

export function icon(name) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "0 0 16 16");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
  path.setAttribute("d", PATHS[name]);
  svg.append(path);
  return svg;
}
