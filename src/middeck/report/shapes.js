"use strict";
// The viewer: projects the points of each side, strokes the lines by colour, and moves them in time.
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const [places, motions] = data.steps;
  const byId = id => document.getElementById(id);
  const [mode, play, scale, speed, colour, legend] = ["mode", "play", "scale", "speed", "colour", "legend"].map(byId);
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const thick = {member: 2.2, body: 1.1, section: 0.8, rigid: 1.2, link: 1.2, spring: 1.2, bushing: 1.2, component: 1.3, cable: 1};
  const dashes = what => what === "component" ? [6, 4] : what === "link" ? [2, 4] : [];
  let [turn, tilt] = data.eye, zoom = 1, phase = Math.PI / 2, playing = false, last = 0;
  document.documentElement.classList.add("js");

  data.rows.forEach((row, i) => {
    const texts = row.map((cell, s) => cell && [data.sides[s].label, cell.text].filter(text => text).join(" "));
    mode.add(new Option(texts.filter(text => text).join(" | "), i));
  });

  const sides = data.sides.map((side, s) => {
    const figure = document.createElement("figure"), canvas = document.createElement("canvas");
    const caption = document.createElement("figcaption");
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "img");
    figure.append(canvas, caption);
    byId("sides").append(figure);
    return {side, s, canvas, caption, context: canvas.getContext("2d")};
  });

  const ink = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const cellOf = view => data.rows[mode.value][view.s];

  function projection() {
    const a = turn * Math.PI / 180, e = tilt * Math.PI / 180;
    const [ca, sa, ce, se] = [Math.cos(a), Math.sin(a), Math.cos(e), Math.sin(e)];
    return (x, y, z) => [ca * x + sa * z, ce * y - se * (ca * z - sa * x)];
  }

  // What all shapes of all sides fill in the view at first: half its width and height, and its middle.
  const frame = (() => {
    const project = projection(), ends = [Infinity, -Infinity, Infinity, -Infinity];
    data.rows.forEach(row => row.forEach((cell, s) => {
      const p = data.sides[s].points;
      for (let i = 0; cell && i < p.length; i += 3) for (const sign of [1, -1]) {
        const [u, v] = project(...[0, 1, 2].map(k => p[i + k] / places + sign * data.reach * cell.motion[i + k] / motions));
        [ends[0], ends[1], ends[2], ends[3]] = [Math.min(ends[0], u), Math.max(ends[1], u), Math.min(ends[2], v), Math.max(ends[3], v)];
      }
    }));
    const [left, right, low, high] = ends, least = data.reach;
    return {wide: Math.max((right - left) / 2, least), high: Math.max((high - low) / 2, least), u: (left + right) / 2, v: (low + high) / 2};
  })();

  function draw(view) {
    const {side, canvas, context: pen} = view, cell = cellOf(view);
    const ratio = window.devicePixelRatio || 1, wide = canvas.clientWidth, high = canvas.clientHeight;
    if (!wide) return;
    const fine = [wide, high].map(x => Math.round(x * ratio));
    if (canvas.width !== fine[0] || canvas.height !== fine[1]) [canvas.width, canvas.height] = fine;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, wide, high);
    const project = projection(), count = side.points.length / 3, room = [wide / 2 - 20, high / 2 - 45];
    const unit = Math.min(room[0] / frame.wide, room[1] / frame.high) * zoom;
    const place = (x, y, z) => {
      const [u, v] = project(x, y, z);
      return [wide / 2 + unit * (u - frame.u), high / 2 - 25 - unit * (v - frame.v)];
    };
    const rest = new Float64Array(2 * count), moved = new Float64Array(2 * count), value = new Float64Array(count);
    const by = cell ? scale.value * data.reach / motions : 0, now = by * Math.sin(phase), before = by * Math.cos(phase);
    const none = [0, 0, 0], at = (motion, i) => motion ? [0, 1, 2].map(k => motion[3 * i + k]) : none;
    for (let i = 0; i < count; i++) {
      const p = [0, 1, 2].map(k => side.points[3 * i + k] / places);
      [rest[2 * i], rest[2 * i + 1]] = place(...p);
      const d = at(cell && cell.motion, i), e = at(cell && cell.quarter, i);
      [moved[2 * i], moved[2 * i + 1]] = place(...p.map((x, k) => x + now * d[k] + before * e[k]));
      value[i] = Math.hypot(...d, ...e) / motions;
    }
    const stroke = (at, first, end) => {
      pen.moveTo(at[2 * first], at[2 * first + 1]);
      for (let i = first + 1; i < end; i++) pen.lineTo(at[2 * i], at[2 * i + 1]);
    };
    pen.lineJoin = pen.lineCap = "round";
    pen.strokeStyle = ink("--ghost");
    for (const what in thick) {
      if (what === "cable") continue;
      pen.lineWidth = 0.6 * thick[what];
      pen.setLineDash(dashes(what));
      pen.beginPath();
      for (const [w, first, end] of side.lines) if (w === what) stroke(rest, first, end);
      pen.stroke();
    }
    const shades = dark.matches ? data.night : data.day;
    const strained = colour.value === "strain", top = cell ? Math.max(1, ...cell.strain) : 1;
    side.lines.forEach(([what, first, end], n) => {
      pen.lineWidth = thick[what];
      pen.setLineDash(dashes(what));
      const plain = what === "cable" || !cell || (strained && what !== "member" && what !== "component");
      const level = v => shades[Math.min(shades.length - 1, Math.floor(v * shades.length))];
      if (plain || strained) {
        pen.strokeStyle = plain ? ink("--soft") : level(cell.strain[n] / top);
        pen.beginPath(); stroke(moved, first, end); pen.stroke();
        return;
      }
      for (let i = first; i + 1 < end; i++) {
        pen.strokeStyle = level((value[i] + value[i + 1]) / 2);
        pen.beginPath(); stroke(moved, i, i + 2); pen.stroke();
      }
    });
    pen.setLineDash([]);
    pen.font = "11px sans-serif";
    for (const [what, i, ...direction] of side.marks) mark(pen, what, moved[2 * i], moved[2 * i + 1], direction.map(x => x * unit * 0.1), project);
    corner(pen, project, unit, high);
    if (side.gravity.some(x => x)) {
      const size = Math.hypot(...side.gravity), [u, v] = project(...side.gravity.map(x => x / size));
      pen.strokeStyle = pen.fillStyle = ink("--lab");
      arrow(pen, wide - 30, 30, wide - 30 + 40 * u, 30 - 40 * v);
      pen.fillText("g " + size.toPrecision(3) + " m/s\u00b2", wide - 110, 20);
    }
  }

  function mark(pen, what, x, y, direction, project) {
    pen.strokeStyle = pen.fillStyle = what === "force" || what === "moment" ? ink("--lab") : ink("--ink");
    pen.lineWidth = 1.5;
    if (what === "clamp") pen.fillRect(x - 5, y - 5, 10, 10);
    else if (what === "support") {
      pen.beginPath(); pen.moveTo(x, y - 6); pen.lineTo(x + 6, y + 5); pen.lineTo(x - 6, y + 5); pen.closePath(); pen.stroke();
    }
    else if (what === "ground") {
      pen.beginPath(); [[0, -6], [6, 0], [0, 6], [-6, 0]].forEach(([u, v]) => pen.lineTo(x + u, y + v)); pen.closePath(); pen.stroke();
    }
    else if (what === "node") { pen.beginPath(); pen.arc(x, y, 2.5, 0, 7); pen.stroke(); }
    else if (what === "mass") { pen.beginPath(); pen.arc(x, y, 4, 0, 7); pen.fill(); }
    else { const [u, v] = project(...direction); arrow(pen, x - u, y + v, x, y); if (what === "moment") pen.fillText("M", x - u, y + v); }
  }

  function arrow(pen, x, y, u, v) {
    const a = Math.atan2(v - y, u - x);
    pen.beginPath(); pen.moveTo(x, y); pen.lineTo(u, v);
    for (const turn of [2.7, -2.7]) { pen.moveTo(u, v); pen.lineTo(u + 7 * Math.cos(a + turn), v + 7 * Math.sin(a + turn)); }
    pen.stroke();
  }

  function corner(pen, project, unit, high) {
    pen.strokeStyle = pen.fillStyle = ink("--soft");
    pen.lineWidth = 1.2;
    ["x", "y", "z"].forEach((name, k) => {
      const [u, v] = project(...data.axes[k]);
      arrow(pen, 40, high - 50, 40 + 26 * u, high - 50 - 26 * v);
      pen.fillText(name, 37 + 36 * u, high - 46 - 36 * v);
    });
    const metres = 80 / unit * data.size, power = 10 ** Math.floor(Math.log10(metres));
    const length = power * [5, 2, 1].find(step => step * power <= metres), wide = length / data.size * unit;
    pen.fillRect(90, high - 16, wide, 3);
    pen.fillText(Number(length.toPrecision(1)) + " m", 90, high - 22);
  }

  function tell() {
    for (const view of sides) {
      const cell = cellOf(view), text = cell ? cell.text : "no partner among the modes shown";
      view.caption.textContent = (view.side.label ? view.side.label + ", " : "") + (cell ? "mode " : "") + text;
      view.canvas.setAttribute("aria-label", view.caption.textContent);
    }
    const metres = (scale.value * data.reach * data.size).toPrecision(2);
    legend.textContent = "The largest motion is drawn as " + metres + " m (" + Math.round(scale.value * data.reach * 100) + " % of the article\u2019s size). Colour from dark to bright: "
      + (colour.value === "strain" ? "share of strain energy, up to that of the member with most" : "motion, up to the largest of the shape") + ".";
    sides.forEach(draw);
  }

  function tick(now) {
    if (!playing) return;
    phase += (now - last) / 1000 * 2 * Math.PI * speed.value;
    last = now;
    sides.forEach(draw);
    requestAnimationFrame(tick);
  }

  function setPlaying(on) {
    playing = on;
    play.textContent = on ? "Stop" : "Play";
    play.setAttribute("aria-pressed", String(on));
    last = performance.now();
    if (on) requestAnimationFrame(tick); else { phase = Math.PI / 2; sides.forEach(draw); }
  }

  function choose(by) {
    mode.value = String((Number(mode.value) + by + data.rows.length) % data.rows.length);
    tell();
  }

  const keys = {
    ArrowLeft: () => turn -= 5, ArrowRight: () => turn += 5, ArrowUp: () => tilt += 5, ArrowDown: () => tilt -= 5,
    "+": () => zoom *= 1.1, "-": () => zoom /= 1.1, " ": () => setPlaying(!playing), n: () => choose(1), p: () => choose(-1),
  };
  for (const {canvas} of sides) {
    canvas.addEventListener("keydown", event => {
      if (!keys[event.key]) return;
      keys[event.key](); event.preventDefault(); sides.forEach(draw);
    });
    canvas.addEventListener("pointerdown", event => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", event => {
      if (!event.buttons) return;
      turn += 0.4 * event.movementX; tilt = Math.max(-90, Math.min(90, tilt + 0.4 * event.movementY));
      sides.forEach(draw);
    });
    canvas.addEventListener("wheel", event => { zoom *= Math.exp(-event.deltaY / 800); event.preventDefault(); sides.forEach(draw); }, {passive: false});
  }
  play.addEventListener("click", () => setPlaying(!playing));
  byId("home").addEventListener("click", () => { [turn, tilt] = data.eye; zoom = 1; tell(); });
  for (const control of [mode, scale, colour]) control.addEventListener("input", tell);
  addEventListener("resize", () => sides.forEach(draw));
  dark.addEventListener("change", () => sides.forEach(draw));
  tell();
  if (!still && !location.hash.includes("still")) setPlaying(true);
})();
