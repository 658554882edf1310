"use strict";
// Current, residual and RMSE of one joint for any values of its parameters. A column is what one parameter asks by one
// effect; the last of a Gram matrix is what the fitted model leaves, so that values are counted from the fitted ones.
(() => {
  const section = document.querySelector(".what-if");
  const find = (selector) => section.querySelector(selector);
  const chooser = find("[name=joint]"), groups = find("[name=group]");
  const readout = find(".readout"), hint = "Drag over a plot to zoom, double-click to see all; point at a dot to read it.";
  let joints, joint, group, plots = [];

  // Numbers

  function unpacked(data) {
    const [x, way, run, current, ...rest] = data.drawn.map((rises, n) => {
      let sum = 0;
      return rises.map((rise) => (sum += rise) * data.steps[n]);
    });
    const errors = data.errors.map((error) => ({ ...error, grams: error.grams.map(square) }));
    const [fit] = errors[0].grams;
    const key = ([, name, present]) => (present ? "" : "missing ") + name, keys = [...new Set(data.columns.map(key))];
    keys.sort((a, b) => b.startsWith("missing ") - a.startsWith("missing "));
    const columns = data.columns.map((column) => [column[0], keys.indexOf(key(column))]);
    const effects = keys.map((text) => {
      const name = text.replace("missing ", ""), shape = data.shapes[name], on = text === name;
      const note = [on ? share(name.replace(/_\d+$/, ""), data.shares) : "missing: try it", shape && `(${shape})`];
      return { title: names[name] ?? name.replaceAll("_", " "), note: note.filter(Boolean).join(" "), on };
    });
    const parameters = data.parameters.map((parameter, p) => {
      if (!parameter.name) return parameter; // what stays as fitted
      const c = columns.findIndex(([q]) => q === p), error = parameter.error ?? 0, value = parameter.value ?? 0;
      const least = Math.sqrt(fit.at(-1).at(-1) / fit[c][c]); // as much as the model leaves
      const reach = Math.max(5 * error, Math.abs(value)) || 5 * least;
      const interval = parameter.interval ?? (error ? [value - 1.96 * error, value + 1.96 * error] : null);
      return { ...parameter, value, interval, range: [value - reach, value + reach], on: effects[columns[c][1]].on };
    });
    return { ...data, errors, fit, columns, effects, parameters, run: run.map(Math.round), x, way, current, left: rest.pop(),
      asked: rest, values: parameters.map((parameter) => parameter.value), on: effects.map((effect) => effect.on) };
  }

  const names = { coulomb: "Coulomb friction", viscous: "viscous friction" };

  /** An effect's share of the mean square current, and the effects that the runs do not separate from it. */
  function share(effect, shares) {
    const group = Object.keys(shares).find((key) => key.split("+").includes(effect));
    const others = group?.split("+").filter((other) => other !== effect).map((other) => names[other] ?? other);
    return group && `${Math.round(100 * shares[group])} %${others.length ? " together with " : ""}${others.join(" and ")}`;
  }

  function square(triangle) {
    const size = (Math.sqrt(8 * triangle.length + 1) - 1) / 2, rows = Array.from({ length: size }, () => Array(size));
    let place = 0;
    for (let n = 0; n < size; n++) for (let m = n; m < size; m++) rows[n][m] = rows[m][n] = triangle[place++];
    return rows;
  }

  /** By how much each column's factor differs from the fitted one. */
  function changes({ columns, parameters, effects, values, on }) {
    return columns.map(([p, e]) => values[p] * on[e] - parameters[p].value * effects[e].on);
  }

  /** Of samples: what is left of means over bins, and inside these. */
  function rmse({ grams, samples }, change) {
    const z = [...change, -1], dot = (row) => row.reduce((sum, value, n) => sum + value * z[n], 0);
    return Math.sqrt(grams.reduce((sum, gram) => sum + Math.max(dot(gram.map(dot)), 0), 0) / samples);
  }

  /** Least squares over the parameters of effects that are on; those that the runs do not tell apart stay. */
  function refit(data) {
    const of = (p) => data.columns.flatMap(([q, e], c) => (q === p && data.on[e] ? [c] : []));
    const free = data.parameters.flatMap((parameter, p) => (parameter.range && of(p).length ? [p] : []));
    const z = [...changes(data), -1], places = free.map(of);
    const sum = (rows, columns) => rows.reduce((total, r) => total + columns.reduce((part, c) => part + data.fit[r][c], 0), 0);
    const rest = (rows) => -rows.reduce((total, r) => total + z.reduce((part, value, c) => part + value * data.fit[r][c], 0), 0);
    const matrix = places.map((rows) => [...places.map((columns) => sum(rows, columns)), rest(rows)]);
    const before = matrix.map((row, n) => row[n]), size = free.length, done = new Set();
    const apart = (n) => (done.has(n) || !before[n] ? 0 : matrix[n][n] / before[n]); // that the others do not explain
    for (let step = 0; step < size; step++) {
      const best = matrix.reduce((best, _, n) => (apart(n) > apart(best) ? n : best), 0);
      if (apart(best) < 1e-9) break;
      const pivot = (matrix[best] = matrix[best].map((value) => value / matrix[best][best]));
      for (let n = 0; n < size; n++)
        if (n !== best) matrix[n] = matrix[n].map((value, m) => value - matrix[n][best] * pivot[m]);
      done.add(best);
    }
    for (const n of done) data.values[free[n]] += matrix[n][size];
    for (const p of free) { // sliders reach what was fitted
      const [low, high] = data.parameters[p].range, value = data.values[p];
      data.parameters[p].range = [Math.min(low, value), Math.max(high, value)];
    }
    controls();
  }

  // Controls

  function element(name, properties, ...children) {
    const made = Object.assign(document.createElement(name), properties);
    made.append(...children);
    return made;
  }

  const digits = (value) => (value && Math.abs(value) < 1e-3 ? value.toExponential(4) : String(Number(value.toPrecision(5))));
  const amperes = (value) => `${value.toPrecision(4)} ${currentUnit}`;

  function slider(p) {
    const { name, unit: [scale, unit], ...parameter } = joint.parameters[p], shown = (value) => scale * value;
    const interval = parameter.interval?.map(shown), [low, high] = parameter.range.map(shown), width = high - low;
    const along = (at) => Math.min(Math.max((at - low) / width, 0), 1), place = (at) => `calc(8px + (100% - 16px) * ${along(at)})`;
    const bar = element("input", { type: "range", min: low, max: high, step: "any" });
    const box = element("input", { type: "number", step: Number((width / 200).toPrecision(1)), id: `what_if_${p}` });
    bar.setAttribute("aria-label", name);
    const track = element("span", { className: "track" });
    if (interval) {
      const band = element("i", { title: `95 % interval: ${digits(interval[0])} to ${digits(interval[1])} ${unit}` });
      band.style.left = place(interval[0]);
      band.style.width = `calc((100% - 16px) * ${along(interval[1]) - along(interval[0])})`;
      track.append(band);
    }
    const mark = element("b", {});
    mark.style.left = place(shown(parameter.value));
    track.append(mark, bar);
    const moved = (text) => {
      if (text === "") return; // or what is no number yet
      joint.values[p] = Number(text) / scale;
      joint.on[joint.columns.find(([q]) => q === p)[1]] = true;
      update();
    };
    bar.addEventListener("input", () => moved(bar.value));
    box.addEventListener("input", () => moved(box.value));
    const label = element("label", { htmlFor: box.id }, name, interval ? "" : element("small", {}, " not identified"));
    const row = element("div", { className: "slider" }, label, track, box, element("small", {}, unit));
    row.show = () => {
      const now = shown(joint.values[p]);
      if (document.activeElement !== box) box.value = digits(now);
      if (document.activeElement !== bar || Number(bar.value) !== now) bar.value = now;
    };
    return row;
  }

  function controls() {
    const sets = joint.effects.map(({ title, note }, e) => {
      const box = element("input", { type: "checkbox", checked: joint.on[e] });
      box.addEventListener("change", () => {
        joint.on[e] = box.checked;
        if (box.checked && !joint.effects[e].on) refit(joint);
        update();
        find(".effects").children[e].querySelector("input").focus({ preventScroll: true });
      });
      const numbers = [...new Set(joint.columns.filter((column) => column[1] === e).map(([p]) => p))];
      const own = numbers.filter((p) => joint.parameters[p].range && joint.columns.find(([q]) => q === p)[1] === e);
      const set = element("fieldset", { className: joint.effects[e].on ? "" : "missing" },
        element("legend", {}, element("label", {}, box, title, element("small", {}, note))), ...own.map(slider));
      set.show = () => { box.checked = joint.on[e]; set.classList.toggle("off", !joint.on[e]); };
      return set;
    });
    find(".effects").replaceChildren(...sets);
  }

  // Plots

  const ink = (name) => getComputedStyle(section).getPropertyValue(name).trim();

  /** Series of the drawn group: x rising, then forward and backward (null elsewhere), then the model or nothing. */
  function series() {
    const change = changes(joint), { run, x, way, current, left, asked } = joint;
    const rows = group.order.map((n) => {
      const residual = left[n] - asked.reduce((sum, column, c) => sum + change[c] * column[n], 0);
      return { n, run: run[n], x: x[n], way: way[n], current: current[n], residual, model: current[n] - residual };
    });
    const split = (key) => [1, -1].map((sign) => rows.map((row) => (row.way * sign > 0 ? row[key] : null)));
    const xs = rows.map((row) => row.x);
    group.rows = rows;
    return [[xs, ...split("current"), rows.map((row) => row.model)], [xs, ...split("residual")]];
  }

  function lines(plot) {
    const { ctx } = plot, ratio = devicePixelRatio;
    ctx.save();
    ctx.beginPath();
    ctx.rect(plot.bbox.left, plot.bbox.top, plot.bbox.width, plot.bbox.height);
    ctx.clip();
    ctx.strokeStyle = ink("--ink");
    ctx.lineWidth = 1.5 * ratio;
    ctx.beginPath();
    const last = new Map(), gaps = group.rows.slice(1).map((row, n) => row.x - group.rows[n].x).sort((a, b) => a - b);
    const pause = joint.axis[0] === "time" && 3 * gaps[gaps.length >> 1];
    for (const row of group.rows) {
      const point = [plot.valToPos(row.x, "x", true), plot.valToPos(row.model, "y", true)], before = last.get(row.run);
      if (before && !(pause && row.x - before[2] > pause)) ctx.moveTo(before[0], before[1]), ctx.lineTo(...point);
      last.set(row.run, [...point, row.x]);
    }
    ctx.stroke();
    ctx.restore();
  }

  function zero(plot) {
    const { ctx, bbox } = plot, at = (value) => plot.valToPos(value, "y", true);
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    if (joint.floor) {
      ctx.fillStyle = ink("--line");
      ctx.fillRect(bbox.left, at(joint.floor), bbox.width, at(-joint.floor) - at(joint.floor));
    }
    ctx.fillStyle = ink("--soft");
    ctx.fillRect(bbox.left, at(0) - 0.5 * devicePixelRatio, bbox.width, devicePixelRatio);
    ctx.restore();
  }

  function pointed(plot, key) {
    const { left, top } = plot.cursor;
    if (left < 0) return void (readout.textContent = hint);
    const far = (row) => Math.hypot(plot.valToPos(row.x, "x") - left, plot.valToPos(row[key], "y") - top);
    const near = group.rows.reduce((best, row) => (far(row) < far(best) ? row : best));
    const [axis, unit] = joint.axis, speed = axis === "time" ? "" : ` at ${joint.speeds[near.run].toPrecision(3)} ${unit}/s`;
    readout.textContent = `${axis} ${digits(near.x)} ${unit}${speed}: measured`
      + ` ${amperes(near.current)}, model ${amperes(near.model)}, residual ${amperes(near.residual)}`;
  }

  function draw() {
    for (const plot of plots) plot.destroy();
    const ahead = ink("--c0072b2") || "#0072b2", back = ink("--cd55e00") || "#d55e00", text = ink("--ink"), data = series();
    const dots = (colour) => ({ stroke: colour, paths: () => null, points: { show: true, size: 4, width: 0, fill: colour } });
    const axis = (label, more) => ({ stroke: text, grid: { stroke: ink("--line"), width: 1 }, ticks: { show: false },
      label, labelSize: 22, labelFont: "13px system-ui, sans-serif", font: "12px system-ui, sans-serif", ...more });
    plots = [["current", `current (${currentUnit})`, 300, lines, []], ["residual", `residual (${currentUnit})`, 220, zero, []]].map(
      ([name, label, height, drawn], n) => {
        const hooks = { setCursor: [(plot) => plot === plots.find((p) => p.root.matches(":hover")) && pointed(plot, name)] };
        hooks[n ? "drawAxes" : "draw"] = [drawn];
        return new uPlot({
          width: find(`.${name}`).clientWidth, height, hooks, legend: { show: false },
          cursor: { sync: { key: "what_if" }, points: { show: false }, y: false },
          scales: { x: { time: false } },
          axes: [axis(`${joint.axis[0]} (${joint.axis[1]})`, { size: 30 }), axis(label, { size: 58 })],
          series: [{}, dots(ahead), dots(back), ...(n ? [] : [{ paths: () => null, points: { show: false } }])],
        }, data[n], find(`.${name}`));
      });
    find(".back").hidden = joint.way.every((way) => way > 0);
    find(".ahead").hidden = joint.way.every((way) => way < 0);
    readout.textContent = hint;
  }

  function update() {
    const change = changes(joint);
    const parts = joint.errors.map((error) => {
      const now = rmse(error, change), was = rmse(error, change.map(() => 0)), percent = 100 * (now / was - 1);
      const rise = `${percent > 0 ? "+" : "−"}${Math.abs(percent).toFixed(1)} %, model ${amperes(was)}`;
      const times = `${(now / was).toPrecision(2)} times the model's ${amperes(was)}`;
      const told = Math.abs(percent) < 0.05 ? "as the model" : percent < 100 ? rise : times;
      return element("div", {}, element("dt", {}, `RMSE of ${error.runs}`),
        element("dd", { className: percent > 0.05 ? "worse" : "" }, amperes(now), element("small", {}, told)));
    });
    if (joint.floor) parts.push(element("div", {}, element("dt", {}, "noise floor"), element("dd", {}, amperes(joint.floor))));
    find(".numbers").replaceChildren(...parts);
    for (const row of find(".effects").querySelectorAll("fieldset, .slider")) row.show();
    series().forEach((data, n) => {
      const plot = plots[n], { min, max } = plot.scales.x; // the zoom stays
      plot.batch(() => {
        plot.setData(data);
        if (min != null) plot.setScale("x", { min, max });
      });
    });
  }

  function choose() {
    const start = joint.groups.slice(0, groups.selectedIndex).reduce((sum, [, count]) => sum + count, 0);
    const numbers = Array.from({ length: joint.groups[groups.selectedIndex][1] }, (_, n) => start + n);
    group = { order: numbers.sort((a, b) => joint.x[a] - joint.x[b]) };
    draw();
    update();
  }

  function open() {
    joint = joints[chooser.selectedIndex];
    groups.replaceChildren(...joint.groups.map(([name]) => element("option", {}, name)));
    controls();
    choose();
  }

  section.hidden = false;
  joints = JSON.parse(document.getElementById("what_if_data").textContent).map(unpacked);
  const missing = joints.map(({ effects }) => effects.filter(({ on }) => !on).map(({ title }) => title));
  const lacking = missing.map((titles) => (titles.length ? `: ${[...new Set(titles)].join(", ")} missing` : ""));
  chooser.replaceChildren(...joints.map(({ title }, n) => element("option", {}, title + lacking[n])));
  chooser.selectedIndex = Math.max(missing.findIndex((titles) => titles.length), 0);
  chooser.addEventListener("change", open);
  groups.addEventListener("change", choose);
  find("[name=fit]").addEventListener("click", () => { refit(joint); update(); });
  find("[name=reset]").addEventListener("click", () => {
    joint.values = joint.parameters.map((parameter) => parameter.value);
    joint.on = joint.effects.map((effect) => effect.on);
    update();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", choose);
  addEventListener("resize", () => plots.forEach((plot) => plot.setSize({ width: find(".current").clientWidth, height: plot.height })));
  open();
})();
