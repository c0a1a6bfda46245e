// The interactive plan on its page: draws, drags and turns sensors, and shows the metrics of what is placed now.
"use strict";
(() => {
  const plan = RoomPlan.planOf(JSON.parse(document.getElementById("plan-data").textContent));
  const root = document.getElementById("interactive-plan"), canvas = root.querySelector("canvas");
  const find = (name) => root.querySelector(`[data-part="${name}"]`);
  const copyOf = (sensor) => ({ ...sensor, xyz: [...sensor.xyz] });
  const original = plan.sensors.map(copyOf);
  const models = [...new Map([...original].reverse().map((each) => [JSON.stringify(each.model), each])).values()].reverse();
  const cells = RoomPlan.cellsOf(plan.area, plan.cell_m);
  const coarse = cells.map((_, i) => i).filter((i) => i % 5 === 0);
  let sensors = original.map(copyOf), chosen = sensors[0], drag = null, found = new Map();

  // ---- metrics -----------------------------------------------------------------------------------------------------
  function measure(sensor, rough) {
    const points = rough ? coarse.map((i) => cells[i]) : cells;
    found.set(sensor, { rough, values: RoomPlan.resolution(plan, sensor, points) });
  }
  function seenBy() { // number of sensors that see each cell; cells that a rough pass left out copy their neighbour
    const counts = new Int16Array(cells.length);
    for (const sensor of sensors) {
      const { rough, values } = found.get(sensor), least = RoomPlan.wanted(plan, sensor);
      for (let i = 0; i < cells.length; i++) if (values[rough ? Math.floor(i / 5) : i] >= least) counts[i]++;
    }
    return counts;
  }
  const faultsOf = (sensor) => RoomPlan.faultsOf(plan, sensor, sensors);
  function best(kindIsLaser) {
    return cells.map((_, i) => Math.max(0, ...sensors.filter((each) => (each.kind === "laser") === kindIsLaser)
      .map((each) => { const { rough, values } = found.get(each); return values[rough ? Math.floor(i / 5) : i]; })));
  }

  // ---- drawing -----------------------------------------------------------------------------------------------------
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  let scale = 1, left = 0, top = 0;
  function fit() {
    const points = [...plan.area, ...plan.outline], margin_m = 0.5;
    const low = [0, 1].map((axis) => Math.min(...points.map((each) => each[axis])) - margin_m);
    const high = [0, 1].map((axis) => Math.max(...points.map((each) => each[axis])) + margin_m);
    const width = root.querySelector(".plan-canvas").clientWidth, ratio = window.devicePixelRatio || 1;
    const height = Math.min((width * (high[1] - low[1])) / (high[0] - low[0]), 640);
    canvas.style.height = `${height}px`;
    canvas.width = width * ratio; canvas.height = height * ratio;
    scale = Math.min(canvas.width / (high[0] - low[0]), canvas.height / (high[1] - low[1]));
    left = low[0] - (canvas.width / scale - (high[0] - low[0])) / 2; top = high[1] + (canvas.height / scale - (high[1] - low[1])) / 2;
  }
  const toPixel = ([x, y]) => [(x - left) * scale, (top - y) * scale];
  const toRoom = (u, v) => [left + u / scale, top - v / scale];
  const ramp = (share) => { // light to dark blue, for any theme
    const t = Math.min(Math.max(share, 0), 1);
    return `rgb(${Math.round(214 - 190 * t)}, ${Math.round(230 - 130 * t)}, ${Math.round(244 - 60 * t)})`;
  };
  function shades(kind) {
    if (kind === "count") {
      const counts = seenBy();
      return Array.from(counts, (value) => (value ? ramp((value - 1) / Math.max(sensors.length - 1, 1)) : null));
    }
    const laser = kind === "beams", values = best(laser), least = laser ? plan.beams : plan.px_per_m;
    return values.map((value) => (value >= least ? ramp(Math.log2(value / least) / 3) : null));
  }
  function outline(pen, corners) {
    pen.beginPath();
    corners.forEach((each, i) => pen[i ? "lineTo" : "moveTo"](...toPixel(each)));
    pen.closePath();
  }
  function draw() {
    fit();
    const pen = canvas.getContext("2d"), ratio = window.devicePixelRatio || 1, half = plan.cell_m / 2;
    pen.clearRect(0, 0, canvas.width, canvas.height);
    shades(find("map").value).forEach((shade, i) => {
      const [x, y] = cells[i], from = toPixel([x - half, y + half]).map(Math.round), to = toPixel([x + half, y - half]).map(Math.round);
      pen.fillStyle = shade ?? "#e59a8c";
      pen.fillRect(from[0], from[1], to[0] - from[0], to[1] - from[1]);
    });
    pen.fillStyle = colour("--quiet");
    for (const each of plan.solid) {
      if (each.high < 0.1 || each.low > 1.8) continue; // neither floor marks nor lamps
      outline(pen, each.corners); pen.globalAlpha = each.high > 1.5 ? 1 : 0.35; pen.fill();
    }
    pen.globalAlpha = 1;
    pen.fillStyle = "#8fd0ea"; pen.strokeStyle = "#3b9fc4"; pen.lineWidth = ratio;
    for (const pane of plan.panes) { outline(pen, pane.corners); pen.fill(); pen.stroke(); }
    pen.strokeStyle = colour("--quiet"); outline(pen, plan.outline); pen.stroke();
    plan.constraints.zones.forEach((zone) => drawZone(pen, zone, ratio));
    pen.setLineDash([6 * ratio, 4 * ratio]); pen.strokeStyle = "#11151a"; pen.lineWidth = ratio;
    outline(pen, plan.area); pen.stroke(); pen.setLineDash([]);
    drawScale(pen, ratio);
    for (const sensor of drawn()) {
      const together = sensors.filter((each) => Math.hypot(...[0, 1].map((axis) => each.xyz[axis] - sensor.xyz[axis])) * scale < 8 * ratio);
      drawSensor(pen, sensor, together.map((each) => sensors.indexOf(each) + 1).join(","), ratio);
    }
  }
  function drawZone(pen, { corners, name }, ratio) { // hatched, as on the printed plan
    pen.save();
    pen.strokeStyle = pen.fillStyle = "#b5341f"; pen.lineWidth = 0.7 * ratio;
    outline(pen, plan.outline); pen.clip(); outline(pen, corners); pen.stroke(); pen.clip();
    const pixels = corners.map(toPixel), [low, high] = [Math.min, Math.max].map((end) => [0, 1].map((axis) => end(...pixels.map((each) => each[axis]))));
    pen.globalAlpha = 0.5; pen.beginPath();
    for (let u = low[0] - (high[1] - low[1]); u < high[0]; u += 9 * ratio) { pen.moveTo(u, high[1]); pen.lineTo(u + high[1] - low[1], low[1]); }
    pen.stroke(); pen.restore(); pen.save();
    const shown = corners.filter(([x, y]) => RoomPlan.inside(plan.outline, x, y)), of = shown.length ? shown : corners;
    const middle = toPixel([0, 1].map((axis) => of.reduce((sum, each) => sum + each[axis], 0) / of.length));
    pen.fillStyle = "#b5341f"; pen.strokeStyle = "#fff"; pen.lineWidth = 3 * ratio; pen.font = `${11 * ratio}px system-ui, sans-serif`;
    pen.textAlign = "center"; pen.textBaseline = "middle";
    for (const way of ["strokeText", "fillText"]) pen[way](name, ...middle);
    pen.restore();
  }
  function drawScale(pen, ratio) { // a bar of whole metres, and the directions of x and y
    const metres = [1, 2, 5, 10, 20, 50].find((each) => each * scale > 50 * ratio) ?? 100, [u, v] = [12 * ratio, canvas.height - 12 * ratio];
    pen.strokeStyle = pen.fillStyle = colour("--ink"); pen.lineWidth = 1.5 * ratio; pen.font = `${11 * ratio}px system-ui, sans-serif`;
    pen.textAlign = "left"; pen.textBaseline = "middle"; pen.beginPath();
    pen.moveTo(u, v - 4 * ratio); pen.lineTo(u, v + 4 * ratio); pen.moveTo(u, v); pen.lineTo(u + metres * scale, v);
    pen.moveTo(u + metres * scale, v - 4 * ratio); pen.lineTo(u + metres * scale, v + 4 * ratio); pen.stroke();
    pen.fillText(`${metres} m; x →, y ↑`, u + metres * scale + 6 * ratio, v);
  }
  const drawn = () => [...sensors.filter((each) => each !== chosen), chosen]; // the chosen one over those at the same place
  function tipOf(sensor) { // of the arrow, which turns the sensor
    const [u, v] = toPixel(sensor.xyz), angle = sensor.yaw_deg * RoomPlan.rad, length = 34 * (window.devicePixelRatio || 1);
    return [u + length * Math.cos(angle), v - length * Math.sin(angle)];
  }
  function drawSensor(pen, sensor, numbers, ratio) {
    const [u, v] = toPixel(sensor.xyz), [tu, tv] = tipOf(sensor), wrong = faultsOf(sensor).length > 0;
    const ink = wrong ? "#c2330f" : sensor === chosen ? "#0b57d0" : "#11151a";
    for (const [shade, wider] of [["#fff", 1.5 * ratio], [ink, 0]]) { // a white edge: the map is light, the page may be dark
      pen.strokeStyle = pen.fillStyle = shade; pen.lineWidth = 2 * (ratio + wider);
      pen.beginPath(); pen.moveTo(u, v); pen.lineTo(tu, tv); pen.stroke();
      pen.beginPath(); pen.arc(tu, tv, 4 * ratio + wider, 0, 7); pen.fill();
      pen.beginPath(); pen.arc(u, v, 10 * ratio + wider, 0, 7); pen.fill();
    }
    pen.fillStyle = "#fff"; pen.font = `${11 * ratio}px system-ui, sans-serif`;
    pen.textAlign = "center"; pen.textBaseline = "middle"; pen.fillText(numbers, u, v, 17 * ratio);
  }

  // ---- text --------------------------------------------------------------------------------------------------------
  const percent = (share) => `${(100 * share).toFixed(1)} %`;
  function tell() {
    const counts = seenBy(), blind = counts.filter((value) => !value).length * plan.cell_m ** 2, shares = {};
    const rows = sensors.map((sensor, i) => {
      const { values } = found.get(sensor), least = RoomPlan.wanted(plan, sensor);
      shares[sensor.name] = values.filter((value) => value >= least).length / Math.max(values.length, 1);
      const price = sensor.price === null ? "" : `<td class="num">${sensor.price}</td>`;
      return `<tr data-row="${i}"${sensor === chosen ? ' class="chosen"' : ""}><td>${i + 1}</td><th></th>` +
        `<td class="num">${percent(shares[sensor.name])}</td>${price}</tr>`;
    });
    find("rows").innerHTML = rows.join("");
    find("rows").querySelectorAll("th").forEach((each, i) => { each.textContent = sensors[i].name; });
    const total = cells.length || 1, price = RoomPlan.priceOf(plan, sensors), { budget, cable } = plan.constraints;
    const faults = sensors.flatMap((each) => faultsOf(each).map((fault) => `${each.name}: ${fault}`));
    if (price !== null && budget != null && price > budget + 1e-9) faults.push(`price ${+price.toFixed(2)}: over the budget of ${budget}`);
    find("faults").textContent = faults.length ? `Not allowed – ${faults.join("; ")}.` : "";
    find("sum").textContent = [
      `seen by at least 1: ${percent(counts.filter((value) => value >= 1).length / total)}`,
      `by at least 2: ${percent(counts.filter((value) => value >= 2).length / total)}`,
      `blind: ${blind < 1 ? +blind.toPrecision(2) : blind.toFixed(1)} m²`,
      ...(price === null ? [] : [`price ${cable ? "with cables" : "of the devices"}: ${+price.toFixed(2)}`]),
    ].join(" · ");
    for (const [field, value] of Object.entries({
      x: chosen.xyz[0], y: chosen.xyz[1], z: chosen.xyz[2], yaw: chosen.yaw_deg, pitch: chosen.pitch_deg, roll: chosen.roll_deg,
    })) if (document.activeElement !== find(field)) find(field).value = +value.toFixed(3);
    find("model").value = Math.max(0, models.findIndex((each) => JSON.stringify(each.model) === JSON.stringify(chosen.model)));
    find("name").textContent = chosen.name;
    const yaml = RoomPlan.yamlOf(plan, sensors, original);
    if (yaml !== find("yaml").value) find("copied").textContent = "";
    find("yaml").value = yaml;
    if (![...found.values()].some((each) => each.rough)) root.dataset.floorShares = JSON.stringify(shares);
  }
  function update(changed, rough = false) {
    for (const sensor of changed) measure(sensor, rough);
    draw(); tell();
  }

  // ---- what the reader does ----------------------------------------------------------------------------------------
  const at = (event) => {
    const box = canvas.getBoundingClientRect(), ratio = canvas.width / box.width;
    return [(event.clientX - box.left) * ratio, (event.clientY - box.top) * ratio];
  };
  const heldAt = (event, isFinger) => { // what a pointer takes hold of: the arrow of the chosen sensor, a sensor, nothing
    const [u, v] = at(event);
    const reach = (isFinger ? 24 : 14) * (window.devicePixelRatio || 1);
    const near = (point) => Math.hypot(point[0] - u, point[1] - v) < reach;
    if (near(tipOf(chosen))) return { sensor: chosen, turns: true };
    const held = drawn().reverse().find((each) => near(toPixel(each.xyz)));
    return held ? { sensor: held, turns: false } : null;
  };
  canvas.addEventListener("touchstart", (event) => { // a finger beside the sensors scrolls the page
    if (event.touches.length === 1 && heldAt(event.touches[0], true)) event.preventDefault();
  }, { passive: false });
  canvas.addEventListener("pointerdown", (event) => {
    drag = heldAt(event, event.pointerType === "touch");
    if (!drag) return;
    chosen = drag.sensor; canvas.setPointerCapture(event.pointerId); update([]);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!drag) return;
    const [x, y] = toRoom(...at(event)), { sensor } = drag;
    if (drag.turns) sensor.yaw_deg = Math.round(Math.atan2(y - sensor.xyz[1], x - sensor.xyz[0]) / RoomPlan.rad);
    else { sensor.xyz[0] = Math.round(x * 100) / 100; sensor.xyz[1] = Math.round(y * 100) / 100; }
    update([sensor], true);
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, () => { if (drag) { const { sensor } = drag; drag = null; update([sensor]); } });
  }
  const setters = {
    x: (value) => { chosen.xyz[0] = value; }, y: (value) => { chosen.xyz[1] = value; }, z: (value) => { chosen.xyz[2] = value; },
    yaw: (value) => { chosen.yaw_deg = value; }, pitch: (value) => { chosen.pitch_deg = value; }, roll: (value) => { chosen.roll_deg = value; },
  };
  for (const [field, set] of Object.entries(setters)) {
    find(field).addEventListener("input", (event) => {
      const value = event.target.valueAsNumber;
      if (Number.isFinite(value)) { set(value); update([chosen]); }
    });
  }
  models.forEach((each, i) => find("model").add(new Option(`${each.kind} as ${each.name}`, i)));
  find("model").addEventListener("change", (event) => {
    const { kind, model, field, mount_from_sensor, price, role, role_z, is_device } = models[event.target.value];
    if (is_device !== chosen.is_device) chosen.device = chosen.name; // it is carried no more, or carries nothing
    Object.assign(chosen, { kind, model, field, mount_from_sensor, price, role, role_z, is_device }); update([chosen]);
  });
  find("rows").addEventListener("click", (event) => {
    const row = event.target.closest("tr");
    if (row) { chosen = sensors[row.dataset.row]; update([]); }
  });
  find("map").addEventListener("change", draw);
  find("add").addEventListener("click", () => {
    let number = 2;
    while (sensors.some((each) => each.name === `${chosen.name}_${number}`)) number++;
    const added = copyOf({ ...chosen, name: `${chosen.name}_${number}`, device: `${chosen.name}_${number}` });
    added.xyz = RoomPlan.placeBeside(plan, chosen, sensors); sensors.push(added); chosen = added; update([added]);
  });
  find("remove").addEventListener("click", () => {
    if (sensors.length < 2) return;
    found.delete(chosen); sensors = sensors.filter((each) => each !== chosen); chosen = sensors[0]; update([]);
  });
  find("reset").addEventListener("click", () => {
    found = new Map(); sensors = original.map(copyOf); chosen = sensors[0]; update(sensors);
  });
  find("copy").addEventListener("click", async () => {
    find("yaml").select();
    let copied = true;
    try { await navigator.clipboard.writeText(find("yaml").value); } catch { copied = document.execCommand("copy"); }
    find("copied").textContent = copied ? `copied: save it as ${plan.saved_as}` : "not copied: the text below is selected";
  });
  window.addEventListener("resize", draw);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  update(sensors);
})();
