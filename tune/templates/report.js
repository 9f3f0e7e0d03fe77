// The stable region as a surface that can be turned: a few hundred quadrilaterals, farthest first.
"use strict";
(() => {
  const data = JSON.parse(document.getElementById("surface").textContent);
  const canvas = document.getElementById("region");
  const context = canvas.getContext("2d");
  const dark = window.matchMedia("screen and (prefers-color-scheme: dark)");
  let yaw = -0.6, pitch = 0.45, printing = false;

  // A point of the unit cube on the canvas: [right, down, nearness].
  function project(x, y, z) {
    const a = x - 0.5, b = y - 0.5, c = (z - 0.5) * 0.8;
    const across = a * Math.cos(yaw) - b * Math.sin(yaw);
    const away = a * Math.sin(yaw) + b * Math.cos(yaw);
    const up = c * Math.cos(pitch) + away * Math.sin(pitch);
    const near = c * Math.sin(pitch) - away * Math.cos(pitch);
    const size = Math.min((canvas.clientWidth - 120) / 1.42, (canvas.clientHeight - 90) / 1.42);
    return [canvas.clientWidth / 2 + size * across, canvas.clientHeight / 2 - size * up, near];
  }

  function colours() {
    return dark.matches && !printing
      ? { ink: "#e4e8eb", faint: "#8b969e", wire: "#E69F00", hue: [86, 160, 215], paper: "#1d2327" }
      : { ink: "#1c2126", faint: "#7a858e", wire: "#B34E00", hue: [100, 165, 215], paper: "#f4f6f7" };
  }

  function path(points, close) {
    context.beginPath();
    points.forEach((point, index) => context[index ? "lineTo" : "moveTo"](point[0], point[1]));
    if (close) context.closePath();
  }

  // What of a polygon lies below the top of the picture.
  function below(corners) {
    return corners.flatMap((corner, index) => {
      const next = corners[(index + 1) % corners.length];
      const kept = corner[2] <= 1 ? [corner] : [];
      if ((corner[2] <= 1) === (next[2] <= 1)) return kept;
      const part = (1 - corner[2]) / (next[2] - corner[2]);
      return [...kept, corner.map((value, axis) => value + part * (next[axis] - value))];
    });
  }

  // Every facet, line and stem with its depth.
  function parts(colour) {
    const found = [];
    const quads = (heights, draw) => {
      for (let row = 0; row + 1 < data.mass.length; row++) {
        for (let column = 0; column + 1 < data.damping[0].length; column++) {
          const corners = [[row, column], [row, column + 1], [row + 1, column + 1], [row + 1, column]];
          const raised = corners.map(([r, c]) => heights[r][c]);
          if (Math.max(...raised) <= 0) continue;
          const whole = corners.map(([r, c]) => [data.damping[r][c], data.mass[r], heights[r][c]]);
          const points = below(whole).map((corner) => project(...corner));
          if (points.length < 3) continue;
          const depth = points.reduce((sum, point) => sum + point[2], 0) / points.length;
          found.push({ depth, draw: () => draw(points, raised) });
        }
      }
    };
    quads(data.margin, (points, raised) => {
      const light = 0.72 + 0.45 * raised.reduce((sum, each) => sum + each, 0) / 4;
      const [r, g, b] = colour.hue.map((each) => Math.min(255, Math.round(each * light)));
      path(points, true);
      context.fillStyle = `rgba(${r},${g},${b},0.82)`;
      context.strokeStyle = `rgba(${Math.round(r * 0.6)},${Math.round(g * 0.6)},${Math.round(b * 0.6)},0.5)`;
      context.lineWidth = 0.5;
      context.fill();
      context.stroke();
    });
    quads(data.worst, (points) => {
      path(points, true);
      context.strokeStyle = colour.wire;
      context.globalAlpha = 0.35;
      context.lineWidth = 0.6;
      context.stroke();
      context.globalAlpha = 1;
    });
    return found.sort((one, other) => one.depth - other.depth);
  }

  // The edges on which ticks stand: of each axis the lower edge that is nearest.
  function drawAxes(colour) {
    const back = (corner) => project(...corner)[2];
    const y0 = back([0.5, 0, 0]) > back([0.5, 1, 0]) ? 0 : 1;
    const x0 = back([0, 0.5, 0]) > back([1, 0.5, 0]) ? 0 : 1;
    const edges = [
      (t) => [t, y0, 0],
      (t) => [x0, t, 0],
      leftmost,
    ];
    const middle = project(0.5, 0.5, 0.5);
    context.font = "11px system-ui, sans-serif";
    context.textBaseline = "middle";
    data.axes.forEach((axis, index) => {
      const edge = edges[index];
      path([project(...edge(0)), project(...edge(1))], false);
      context.strokeStyle = colour.faint;
      context.lineWidth = 1;
      context.stroke();
      context.fillStyle = colour.faint;
      const ends = [project(...edge(0)), project(...edge(1))];
      const centre = [(ends[0][0] + ends[1][0]) / 2, (ends[0][1] + ends[1][1]) / 2];
      const away = index === 2 ? [-1, 0] : unit([centre[0] - middle[0], centre[1] - middle[1]]);
      let last = null, widest = 0;
      axis.ticks.forEach(([place, words]) => {
        const at = project(...edge(place));
        const width = context.measureText(words).width;
        const where = [at[0] + (8 + width / 2) * away[0], at[1] + 14 * away[1]];
        widest = Math.max(widest, width);
        if (last && Math.abs(last[0] - where[0]) < width + 6 && Math.abs(last[1] - where[1]) < 13) return;
        last = where;
        context.textAlign = index === 2 ? "right" : "center";
        context.fillText(words, index === 2 ? at[0] - 6 : where[0], where[1]);
      });
      context.fillStyle = colour.ink;
      if (index === 2) {
        const top = ends[0][1] < ends[1][1] ? ends[0] : ends[1];
        context.textAlign = "left";
        context.fillText(axis.title, Math.max(6, top[0] - 40), Math.max(10, top[1] - 14));
      } else {
        context.textAlign = "center";
        const half = context.measureText(axis.title).width / 2 + 4;
        const x = centre[0] + (14 + widest + half) * away[0];
        const y = centre[1] + 34 * away[1];
        context.fillText(
          axis.title,
          Math.min(canvas.clientWidth - half, Math.max(half, x)),
          Math.min(canvas.clientHeight - 8, y),
        );
      }
    });
  }

  function unit([x, y]) {
    const length = Math.hypot(x, y) || 1;
    return [x / length, y / length];
  }

  // The upright edge that stands farthest to the left.
  function leftmost(t) {
    const corners = [[0, 0], [0, 1], [1, 0], [1, 1]];
    corners.sort((one, other) => project(...one, 0)[0] - project(...other, 0)[0]);
    return [...corners[0], t];
  }

  function drawElements(colour) {
    const taken = [];
    data.elements.forEach((element) => {
      const [x, y, z] = element.at;
      const at = project(x, y, z);
      path([project(x, y, 0), at], false);
      context.strokeStyle = colour.ink;
      context.lineWidth = 1;
      context.stroke();
      context.beginPath();
      context.arc(at[0], at[1], 4, 0, 2 * Math.PI);
      context.fillStyle = colour.ink;
      context.fill();
      taken.push([at[0] - 5, at[1] - 5, at[0] + 5, at[1] + 5]);
    });
    context.font = "600 12px system-ui, sans-serif";
    context.textAlign = "left";
    data.elements.forEach((element) => {
      const at = project(...element.at);
      const words = element.name.length > 24 ? element.name.slice(0, 23) + "…" : element.name;
      const width = context.measureText(words).width;
      const free = offsets(width).map(([x, y]) => [at[0] + x, at[1] + y]).find(([x, y]) =>
        x > 2 && x + width < canvas.clientWidth - 2
        && taken.every((box) => x > box[2] || x + width < box[0] || y - 8 > box[3] || y + 8 < box[1]));
      if (!free) return;
      taken.push([free[0], free[1] - 8, free[0] + width, free[1] + 8]);
      context.lineWidth = 3;
      context.strokeStyle = colour.paper;
      context.strokeText(words, ...free);
      context.fillText(words, ...free);
    });
  }

  function offsets(width) {
    const found = [];
    for (const away of [0, 14, 28, 42, 56]) {
      found.push([8, -4 - away], [-8 - width, -4 - away], [8, 12 + away], [-8 - width, 12 + away]);
    }
    return found;
  }

  function draw() {
    const ratio = window.devicePixelRatio || 1;
    canvas.width = Math.round(canvas.clientWidth * ratio);
    canvas.height = Math.round(canvas.clientHeight * ratio);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const colour = colours();
    drawAxes(colour);
    parts(colour).forEach((part) => part.draw());
    drawElements(colour);
    canvas.dataset.yaw = yaw.toFixed(3);
    canvas.dataset.pitch = pitch.toFixed(3);
  }

  function turn(right, up) {
    yaw = (yaw + right) % (2 * Math.PI);
    pitch = Math.min(1.5, Math.max(-0.2, pitch + up));
    window.requestAnimationFrame(draw);
  }

  let held = null;
  canvas.addEventListener("pointerdown", (event) => {
    held = [event.clientX, event.clientY];
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!held) return;
    turn((event.clientX - held[0]) * 0.01, (event.clientY - held[1]) * 0.01);
    held = [event.clientX, event.clientY];
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { held = null; });
  const keys = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] };
  canvas.addEventListener("keydown", (event) => {
    if (!keys[event.key]) return;
    event.preventDefault();
    turn(...keys[event.key]);
  });
  window.addEventListener("resize", draw);
  window.addEventListener("beforeprint", () => { printing = true; draw(); });
  window.addEventListener("afterprint", () => { printing = false; draw(); });
  dark.addEventListener("change", draw);
  draw();
})();
