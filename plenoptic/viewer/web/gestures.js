// Mouse, touch and pen on the stage, as what is meant by them.

const STILL = 5; // CSS pixels within which a press is a tap

/** Calls of `on`: hover(point), leave(), drag(dx, dy, point), tap(point), zoom(factor, point), pan(dx, dy). */
export function watchGestures(stage, on) {
  const pressed = new Map();
  let moved = false, started = null;
  const at = (event) => {
    const box = stage.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  };
  const spread = () => {
    const [a, b] = [...pressed.values()];
    return { middle: { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2 }, apart: Math.hypot(a.x - b.x, a.y - b.y) };
  };

  stage.addEventListener("pointerdown", (event) => {
    if (event.pointerType === "mouse" && event.button !== 0) return;
    stage.setPointerCapture(event.pointerId);
    pressed.set(event.pointerId, at(event));
    moved = moved && pressed.size > 1;
    if (pressed.size === 1) started = at(event);
    if (pressed.size > 1) moved = true;
  });
  stage.addEventListener("pointermove", (event) => {
    const point = at(event);
    const before = pressed.get(event.pointerId);
    if (!before) {
      if (pressed.size === 0) on.hover(point);
      return;
    }
    if (pressed.size === 2) {
      const was = spread();
      pressed.set(event.pointerId, point);
      const is = spread();
      if (was.apart > 0) on.zoom(is.apart / was.apart, is.middle);
      on.pan(is.middle.x - was.middle.x, is.middle.y - was.middle.y);
      return;
    }
    if (!moved && Math.hypot(point.x - started.x, point.y - started.y) < STILL) return;
    moved = true;
    pressed.set(event.pointerId, point);
    if (event.shiftKey) on.pan(point.x - before.x, point.y - before.y);
    else on.drag(point.x - before.x, point.y - before.y, point);
  });
  const released = (event) => {
    if (!pressed.delete(event.pointerId)) return;
    if (event.type === "pointerup" && !moved && pressed.size === 0) on.tap(at(event));
    if (pressed.size === 0) moved = false;
  };
  stage.addEventListener("pointerup", released);
  stage.addEventListener("pointercancel", released);
  stage.addEventListener("pointerleave", () => { if (pressed.size === 0) on.leave(); });
  stage.addEventListener("wheel", (event) => {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1;
    on.zoom(Math.exp(-event.deltaY * lines * 0.0015), at(event));
  }, { passive: false });
}

/** Keys by name, but for those that a control with the focus takes itself. */
export function watchKeys(keys) {
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const control = event.target.closest("input, select, summary, button");
    const own = control && (event.key.startsWith("Arrow") || event.key === "Enter" || event.key === " " ||
      event.key === "Home" || event.key === "End");
    const action = keys[event.key];
    if (!action || own) return;
    event.preventDefault();
    action(event.shiftKey);
  });
}
