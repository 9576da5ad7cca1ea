// Small helpers for elements, and the tabs.

export const calm = () => matchMedia("(prefers-reduced-motion: reduce)").matches;

export const byId = (id) => document.getElementById(id);

export const duration = (s) => (s < 90 ? `${Math.round(s)} s` : s < 5400 ? `${Math.round(s / 60)} min` : `${(s / 3600).toFixed(1)} h`);

// element("button", {title: "x", onclick: f}, "text", child, ...)
export function element(name, fields = {}, ...children) {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(fields)) {
    if (key in node && key !== "list") node[key] = value;
    else node.setAttribute(key, value);
  }
  node.append(...children.filter((child) => child !== null && child !== undefined));
  return node;
}

export function svg(name, fields = {}, ...children) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(fields)) node.setAttribute(key, value);
  node.append(...children);
  return node;
}

// A label with its control in one row; a range shows its value after it.
let n = 0;
export function row(text, control, format = null) {
  control.id ||= `control-${n++}`;
  const parts = [element("label", { htmlFor: control.id }, text), control];
  if (format) {
    const output = element("output", { htmlFor: control.id }, format(control.value));
    for (const name of ["input", "shown"]) control.addEventListener(name, () => (output.textContent = format(control.value)));
    parts.push(output);
  }
  return element("div", { className: "row" }, ...parts);
}

export function select(values, value, onchange) {
  const node = element("select");
  for (const [key, text] of values) node.append(element("option", { value: key, selected: key === value }, text));
  node.addEventListener("change", () => onchange(node.value));
  return node;
}

export function check(text, checked, onchange) {
  const box = element("input", { type: "checkbox", checked });
  box.addEventListener("change", () => onchange(box.checked, box));
  return element("label", { className: "row" }, box, text);
}

// A text stays for some seconds, or until there is another one.
let timer;
export function say(text, bad = false, stays = false) {
  const node = byId("message");
  node.textContent = text;
  node.classList.toggle("bad", bad);
  clearTimeout(timer);
  if (!stays) timer = setTimeout(() => (node.textContent = ""), bad ? 9000 : 4000);
}

// Arrow keys move through a group of buttons, as its ARIA role requires.
export function group(node, attribute, onchange) {
  const buttons = [...node.querySelectorAll("button")];
  const choose = (button, focus) => {
    for (const other of buttons) {
      other.setAttribute(attribute, other === button);
      other.tabIndex = other === button ? 0 : -1;
    }
    if (focus) button.focus();
    onchange(button);
  };
  for (const button of buttons) {
    button.tabIndex = button.getAttribute(attribute) === "true" ? 0 : -1;
    button.addEventListener("click", () => choose(button));
    button.addEventListener("keydown", (e) => {
      const by = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[e.key];
      if (!by) return;
      e.preventDefault();
      choose(buttons[(buttons.indexOf(button) + by + buttons.length) % buttons.length], true);
    });
  }
  return (test) => choose(buttons.find(test));
}

export function tabs(onopen) {
  return group(byId("tabs"), "aria-selected", (button) => {
    for (const tab of byId("tabs").querySelectorAll("button"))
      byId(tab.getAttribute("aria-controls")).hidden = tab !== button;
    onopen(button.getAttribute("aria-controls"));
  });
}
