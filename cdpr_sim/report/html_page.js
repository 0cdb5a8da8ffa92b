"use strict";
// Draws the robot from the page's data: lines, and one box whose faces hide what is behind them.
(() => {
  const { robot, views } = JSON.parse(document.getElementById("scene").textContent);
  const canvas = document.getElementById("robot");
  const pen = canvas.getContext("2d");
  const control = Object.fromEntries(
    ["pose", "turn", "height", "zoom", "tensions", "commanded", "reset"].map((id) => [id, document.getElementById(id)]),
  );
  const sliders = ["turn", "height", "zoom"];
  const home = Object.fromEntries(sliders.map((id) => [id, control[id].value]));

  const add = (a, b, s = 1) => a.map((value, i) => value + s * b[i]);
  const dot = (a, b) => a.reduce((sum, value, i) => sum + value * b[i], 0);
  const mix = (a, b, s) => a.map((value, i) => value + s * (b[i] - value));
  const subdivided = (points, count) => points.slice(1).flatMap((end, i) =>
    [...Array(count).keys()].map((n) => mix(points[i], end, n / count))).concat([points.at(-1)]);
  const middle = mix(robot.frame[0], robot.frame[1], 0.5);
  const half = robot.frame[1].map((value, i) => Math.max((value - robot.frame[0][i]) / 2, robot.platform[i]));
  const footprint = Math.hypot(half[0], half[1]);

  // Edges and faces of a box whose corners are numbered in binary (x, y, z).
  const EDGES = [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];
  const FACES = [[[4, 6, 7, 5], 0, 1], [[0, 1, 3, 2], 0, -1], [[2, 3, 7, 6], 1, 1], [[0, 4, 5, 1], 1, -1],
    [[1, 5, 7, 3], 2, 1], [[0, 2, 6, 4], 2, -1]];
  const corners = (low, high) => [...Array(8).keys()].map((n) => [4, 2, 1].map((bit, i) => (n & bit ? high : low)[i]));
  const placed = ({ position, rotation }, point) => add(position, rotation.map((row) => dot(row, point)));
  const box = corners(robot.platform.map((edge) => -edge / 2), robot.platform.map((edge) => edge / 2));

  function camera(width, height, view) {
    const [turn, up, zoom] = [control.turn.value * Math.PI / 180, control.height.value * Math.PI / 180, +control.zoom.value];
    const [c, s, C, S] = [Math.cos(turn), Math.sin(turn), Math.cos(up), Math.sin(up)];
    const towards = [C * s, -C * c, S], right = [c, s, 0], upwards = [-S * s, S * c, C];
    const tall = half[2] * C + footprint * Math.abs(S);
    const scale = 0.42 * zoom * Math.min(width / footprint, height / Math.max(tall, 0.3 * footprint));
    const target = mix(middle, view.platform.position, 1 - 1 / zoom);
    const distance = 5 * Math.hypot(footprint, half[2]);
    const project = (point) => {
      const from = add(point, target, -1);
      const depth = dot(from, towards), near = distance / Math.max(distance - depth, 0.05 * distance);
      return [width / 2 + scale * near * dot(from, right), height / 2 - scale * near * dot(from, upwards), depth];
    };
    return { project, towards };
  }

  function draw() {
    const view = views[control.pose.selectedIndex];
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    const sharp = window.devicePixelRatio || 1;
    canvas.width = Math.round(width * sharp);
    canvas.height = Math.round(height * sharp);
    pen.setTransform(sharp, 0, 0, sharp, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.lineCap = pen.lineJoin = "round";
    const style = getComputedStyle(document.documentElement);
    const color = (name) => style.getPropertyValue(`--${name}`).trim();
    const { project, towards } = camera(width, height, view);
    const shapes = [];

    // A point beyond one of the visible faces is in front of the box; any other point is behind it.
    const columns = [0, 1, 2].map((axis) => view.platform.rotation.map((row) => row[axis]));
    const seen = FACES.filter(([, axis, sign]) => sign * dot(columns[axis], towards) > 0);
    const inFront = (point) => {
      const from = add(point, view.platform.position, -1);
      return seen.some(([, axis, sign]) => sign * dot(columns[axis], from) > robot.platform[axis] / 2);
    };
    const line = (points, stroke, thick, dash = []) => {
      let drawn = 0;
      for (let i = 1; i < points.length; i++) {
        const [a, b] = [project(points[i - 1]), project(points[i])];
        const offset = drawn; // the dash pattern continues from the previous segment
        drawn += Math.hypot(b[0] - a[0], b[1] - a[1]);
        const layer = inFront(mix(points[i - 1], points[i], 0.5)) ? 2 : 0;
        shapes.push({ layer, depth: (a[2] + b[2]) / 2, paint() {
          pen.beginPath();
          pen.moveTo(a[0], a[1]);
          pen.lineTo(b[0], b[1]);
          pen.strokeStyle = stroke;
          pen.lineWidth = thick;
          pen.setLineDash(dash);
          pen.lineDashOffset = offset;
          pen.stroke();
        } });
      }
    };
    const spot = (point, size) => {
      const [x, y, depth] = project(point);
      shapes.push({ layer: inFront(point) ? 2 : 0, depth, paint() {
        pen.beginPath();
        pen.arc(x, y, size, 0, 2 * Math.PI);
        pen.fillStyle = color("ink");
        pen.fill();
      } });
    };

    const frame = corners(...robot.frame);
    for (const [a, b] of EDGES) line([frame[a], frame[b]], color("frame"), 1);
    robot.wheels.forEach((wheel) => line(wheel, color("quiet"), 1));
    robot.exits.forEach((exit) => spot(exit, 3));
    view.cables.forEach(({ curve, slack }) => {
      const fine = subdivided(curve, curve.length > 2 ? 2 : 40);
      if (slack) line(fine, color("slack"), 2.4, [1, 5]);
      else line(fine, color("ink"), 1.6);
    });
    if (control.commanded.checked) {
      const ghost = box.map((corner) => placed(view.commanded, corner));
      for (const [a, b] of EDGES) line(subdivided([ghost[a], ghost[b]], 12), color("commanded"), 1.2, [4, 3]);
    }
    const solid = box.map((corner) => placed(view.platform, corner));
    for (const [face, axis, sign] of seen) {
      const normal = columns[axis].map((value) => sign * value);
      const outline = face.map((corner) => project(solid[corner]));
      shapes.push({ layer: 1, depth: 0, paint() {
        pen.beginPath();
        outline.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
        pen.closePath();
        pen.fillStyle = color("platform");
        pen.fill();
        pen.fillStyle = `rgb(0 0 0 / ${0.28 * (1 - Math.max(normal[2], 0)) * (0.6 + 0.4 * Math.abs(normal[1]))})`;
        pen.fill();
        pen.setLineDash([]);
        pen.strokeStyle = color("ink");
        pen.lineWidth = 1;
        pen.stroke();
      } });
    }
    shapes.sort((a, b) => a.layer - b.layer || a.depth - b.depth).forEach((shape) => shape.paint());
    label(view, project, color, width, height);
  }

  function label(view, project, color, width, height) {
    const taken = [];
    const put = (text, x, y, ink) => {
      const wide = pen.measureText(text).width;
      x = Math.min(Math.max(x - wide / 2, 2), width - wide - 2);
      y = Math.min(Math.max(y, 14), height - 6);
      const free = (at) => !taken.some(([u, v, w]) => x < u + w + 4 && u < x + wide + 4 && Math.abs(at - v) < 15);
      const moves = [...Array(25).keys()].map((n) => (n % 2 ? 1 : -1) * Math.ceil(n / 2) * 4);
      y += moves.find((move) => y + move > 12 && y + move < height - 4 && free(y + move)) ?? 0;
      taken.push([x, y, wide]);
      pen.lineWidth = 3;
      pen.setLineDash([]);
      pen.strokeStyle = color("card");
      pen.strokeText(text, x, y);
      pen.fillStyle = ink;
      pen.fillText(text, x, y);
    };
    const within = ([x, y]) => x > 4 && x < width - 4 && y > 8 && y < height - 8;
    pen.font = "13px system-ui, sans-serif";
    if (control.tensions.checked) {
      view.cables.forEach(({ curve, slack, label }, cable) => {
        const text = `${cable + 1}: ${label}`, aside = pen.measureText(text).width / 2 + 8;
        const [x, y] = subdivided(curve, 40).map(project).find(within) ?? [NaN];  // at its exit, or where it enters the picture
        if (x) put(text, x + (x < width / 2 ? -aside : aside), y + 4, color(slack ? "slack" : "ink"));
      });
    }
    const [low, high] = robot.frame;
    [["x", 0], ["y", 1], ["z", 2]].forEach(([name, axis]) => {
      const size = high[axis] - low[axis];
      if (!(size > 0)) return;
      const at = [...low];
      if (axis === 1) at[0] = high[0];
      at[axis] = (low[axis] + high[axis]) / 2;
      const [x, y] = project(at);
      if (within([x, y])) put(`${name}: ${+size.toPrecision(3)} m`, x, y + 16, color("quiet"));
    });
  }

  function choose() {
    const view = views[control.pose.selectedIndex];
    canvas.setAttribute("aria-label", view.description);
    document.getElementById("description").textContent = view.description;
    document.querySelectorAll("[data-view]").forEach((answer) => {
      answer.hidden = +answer.dataset.view !== control.pose.selectedIndex;
    });
    draw();
  }

  const nudge = (id, by) => {
    const { min, max, value } = control[id];
    const wrapped = id === "turn" ? ((+value + by + 540) % 360) - 180 : +value + by;
    control[id].value = Math.min(Math.max(wrapped, min), max);
    draw();
  };
  const reset = () => {
    sliders.forEach((id) => { control[id].value = home[id]; });
    draw();
  };
  const KEYS = {
    ArrowLeft: () => nudge("turn", -5), ArrowRight: () => nudge("turn", 5),
    ArrowUp: () => nudge("height", 5), ArrowDown: () => nudge("height", -5),
    "+": () => nudge("zoom", 0.5), "-": () => nudge("zoom", -0.5), Home: reset,
  };
  canvas.addEventListener("keydown", (event) => {
    if (!KEYS[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    KEYS[event.key]();
  });
  let last = null;
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    last = event;
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!last) return;
    nudge("turn", 0.4 * (last.clientX - event.clientX));
    if (event.pointerType === "mouse") nudge("height", 0.4 * (event.clientY - last.clientY));
    last = event;
  });
  ["pointerup", "pointercancel"].forEach((name) => canvas.addEventListener(name, () => { last = null; }));
  [...sliders, "tensions", "commanded"].forEach((id) => control[id].addEventListener("input", draw));
  control.pose.addEventListener("input", choose);
  control.reset.addEventListener("click", reset);
  document.querySelectorAll("[data-show]").forEach((button) => {
    button.addEventListener("click", () => {
      control.pose.selectedIndex = +button.dataset.show;
      choose();
      canvas.scrollIntoView({ block: "center" });
      canvas.focus();
    });
  });
  ["(prefers-color-scheme: dark)", "print"].forEach((media) => matchMedia(media).addEventListener("change", draw));
  new ResizeObserver(draw).observe(canvas);
  choose();
})();
