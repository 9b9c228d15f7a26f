// Controls and texts beside the stage. All text is set as text, never as markup.

import { gradient } from "./colors.js";

export function element(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name in made) made[name] = value;
    else made.setAttribute(name, value);
  }
  made.append(...children);
  return made;
}

/** A slider with its name and what its value means; `set` moves it without calling `input`. */
export function slider({ id, label, min, max, step = "any", value, text, input }) {
  const shown = element("output", { htmlFor: id });
  const range = element("input", { type: "range", id, min, max, step, value });
  const update = () => {
    shown.textContent = text(range.valueAsNumber);
    range.setAttribute("aria-valuetext", shown.textContent);
    range.style.setProperty("--part", `${(100 * (range.valueAsNumber - min)) / (max - min || 1)}%`);
  };
  range.addEventListener("input", () => { update(); input(range.valueAsNumber); });
  update();
  return {
    made: element("div", { className: "slider" }, element("label", { htmlFor: id }, label), shown, range),
    set(to) { range.value = to; update(); },
    hide(hidden) { range.closest(".slider").hidden = hidden; },
  };
}

/** One of several: [value, label] each. */
export function choice({ id, label, options, value, change }) {
  const radios = options.map(([key, name]) => {
    const radio = element("input", { type: "radio", name: id, id: `${id}-${key}`, value: key, checked: key === value });
    radio.addEventListener("change", () => change(key));
    return [radio, element("label", { htmlFor: radio.id }, name)];
  });
  return {
    made: element("fieldset", { className: "choice" }, element("legend", {}, label), ...radios.flat()),
    set(to) { for (const [radio] of radios) radio.checked = radio.value === to; },
  };
}

export function toggle({ id, label, value, change }) {
  const box = element("input", { type: "checkbox", id, checked: value });
  box.addEventListener("change", () => change(box.checked));
  return {
    made: element("label", { className: "toggle" }, box, ` ${label}`),
    set(to) { box.checked = to; },
  };
}

export function button(label, description, click) {
  const made = element("button", { type: "button", title: description, ariaLabel: description }, label);
  made.addEventListener("click", click);
  return made;
}

/** What colours mean: a bar with numbers below it, [share of its length, text] each. */
export function colorBar() {
  const title = element("div", { className: "bar-title" });
  const bar = element("div", { className: "bar" });
  const marks = element("div", { className: "marks" });
  const made = element("div", { className: "color-bar", hidden: true }, title, bar, marks);
  return {
    made,
    show(text, map, ticks) {
      made.hidden = false;
      title.textContent = text;
      bar.style.backgroundImage = gradient(map);
      marks.replaceChildren(...ticks.map(([share, label]) => {
        const mark = element("span", {}, label);
        mark.style.left = `${100 * share}%`;
        return mark;
      }));
    },
    hide() { made.hidden = true; },
  };
}

/** Names and values, a line each; a value of null leaves the line out. */
export function readout(label) {
  const list = element("dl");
  const made = element("section", { className: "readout", ariaLabel: label, ariaLive: "polite" }, list);
  made.id = "readout";
  return {
    made,
    show(lines) {
      list.replaceChildren(...lines.filter(([, value]) => value !== null).flatMap(([name, value]) => [
        element("dt", {}, name), element("dd", {}, value),
      ]));
    },
  };
}

export function keyList(keys) {
  const rows = keys.map(([key, meaning]) =>
    element("div", {}, element("kbd", {}, key), element("span", {}, meaning)));
  return element("details", { className: "keys" }, element("summary", {}, "Mouse, touch and keys"), ...rows);
}

export function notes(title, lines) {
  return element("details", { className: "notes" }, element("summary", {}, title),
    ...lines.map((line) => element("p", {}, line)));
}

/** Say what went wrong in place of the controls; the picture of the page stays. */
export function apology(sentence) {
  document.getElementById("panel").replaceChildren(element("p", { className: "apology", role: "alert" }, sentence));
}

/** The canvases as large as the stage; calls `changed` after each change of its size. */
export function fillStage(stage, canvases, changed) {
  const adapt = () => {
    for (const canvas of canvases) {
      canvas.width = Math.max(1, Math.round(stage.clientWidth * devicePixelRatio));
      canvas.height = Math.max(1, Math.round(stage.clientHeight * devicePixelRatio));
      canvas.style.width = `${canvas.width / devicePixelRatio}px`;
      canvas.style.height = `${canvas.height / devicePixelRatio}px`;
    }
    changed();
  };
  new ResizeObserver(adapt).observe(stage);
  adapt();
}

/** A colour of the style sheet, as numbers of 0 to 1. */
export function styleColor(name) {
  const text = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  return [1, 3, 5].map((at) => parseInt(text.slice(at, at + 2), 16) / 255);
}
