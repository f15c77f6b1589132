// Makes elements. Text is set as text, never as HTML.
const SVG = "http://www.w3.org/2000/svg";
const SVG_TAGS = new Set(["svg", "rect", "circle", "polyline", "text"]);

export function h(tag, props, ...children) {
  const made = SVG_TAGS.has(tag) ? document.createElementNS(SVG, tag) : document.createElement(tag);
  for (const [name, value] of Object.entries(props ?? {})) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (value === true) made.setAttribute(name, "");
    else if (value !== false && value != null) made.setAttribute(name, value);
  }
  made.append(...children.flat(Infinity).filter((child) => child != null && child !== false));
  return made;
}

// Sets text only where it changed: a screen reader is not told twice.
export function say(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

export const button = (text, onclick, props) => h("button", { type: "button", onclick, ...props }, text);

// Asks a question; the promise tells whether the answer was yes.
export function question(title, body, yes, no) {
  return new Promise((resolve) => {
    const dialog = h("dialog", { "aria-labelledby": "asked" }, h("h2", { id: "asked" }, title), body,
      h("div", { class: "row" },
        button(no, () => dialog.close("no"), { class: "plain" }),
        button(yes, () => dialog.close("yes"), { class: "careful" })));
    dialog.addEventListener("close", () => {
      dialog.remove();
      resolve(dialog.returnValue === "yes");
    });
    document.body.append(dialog);
    dialog.showModal();
  });
}
