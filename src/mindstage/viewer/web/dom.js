// DOM helpers: creating elements with attributes and children. Strings become text nodes and are never parsed as HTML.

const present = (children) => children.flat().filter((child) => child !== undefined && child !== null && child !== false);

// Creates an element. Attributes that start with "on" are event listeners; undefined, null and false are left out.
export function el(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (key === "value" || key === "checked" || key === "disabled") element[key] = value;
    else element.setAttribute(key, value === true ? "" : value);
  }
  element.append(...present(children));
  return element;
}

export function replaceChildren(element, ...children) {
  element.replaceChildren(...present(children));
}

// Formats a number with at most `digits` decimals, without trailing zeros and without negative zero.
export function formatNumber(value, digits = 3) {
  return String(Number(value.toFixed(digits)) + 0);
}

// Returns a function that calls `callback` after `delayMs` without another call.
export function debounce(callback, delayMs = 120) {
  let timer = 0;
  return (...args) => {
    clearTimeout(timer);
    timer = setTimeout(() => callback(...args), delayMs);
  };
}
