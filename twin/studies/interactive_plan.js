// Interactive plan: coverage of the floor by sensors that the reader drags, turns and exchanges.
// Computes what twin/studies/visibility.py does; frames, units and names are those of the package.
"use strict";
const RoomPlan = (() => {
  const TRUNK_M = 0.35, LEGS_M = 0.2, TRUNK_FROM_M = 0.7, NUDGE_M = 0.01, SIGHTS = [-2 / 3, 0, 2 / 3];
  const rad = Math.PI / 180;

  // ---- geometry ----------------------------------------------------------------------------------------------------
  function multiply(a, b) {
    return a.map((row) => b[0].map((_, j) => row.reduce((sum, value, k) => sum + value * b[k][j], 0)));
  }
  function apply(m, v) { return m.map((row) => row[0] * v[0] + row[1] * v[1] + row[2] * v[2]); }
  function applyTransposed(m, v) { return [0, 1, 2].map((j) => m[0][j] * v[0] + m[1][j] * v[1] + m[2][j] * v[2]); }

  // Rotation of a mount: yaw about z, then pitch about the new y, then roll about the new x.
  function rotationOf(sensor) {
    const [cy, sy] = [Math.cos(sensor.yaw_deg * rad), Math.sin(sensor.yaw_deg * rad)];
    const [cp, sp] = [Math.cos(sensor.pitch_deg * rad), Math.sin(sensor.pitch_deg * rad)];
    const [cr, sr] = [Math.cos(sensor.roll_deg * rad), Math.sin(sensor.roll_deg * rad)];
    return [
      [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
      [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
      [-sp, cp * sr, cp * cr],
    ];
  }
  function poseOf(sensor) {
    const mount = rotationOf(sensor), offset = apply(mount, sensor.mount_from_sensor.offset_m);
    return {
      rotation: multiply(mount, sensor.mount_from_sensor.rotation),
      origin: sensor.xyz.map((value, axis) => value + offset[axis]),
    };
  }

  // Prisms with the outward normals of their sides, and a bounding circle.
  function prepared(prisms) {
    return prisms.map(({ z, corners }) => {
      const n = corners.length;
      const centre = [0, 1].map((axis) => corners.reduce((sum, each) => sum + each[axis], 0) / n);
      const radius = Math.max(...corners.map((each) => Math.hypot(each[0] - centre[0], each[1] - centre[1])));
      const sides = corners.map((from, i) => {
        const to = corners[(i + 1) % n], nx = to[1] - from[1], ny = from[0] - to[0];
        return [nx, ny, nx * from[0] + ny * from[1]];
      });
      return { low: z[0], high: z[1], x: centre[0], y: centre[1], radius, sides, corners };
    });
  }

  // Distance along a unit direction to the first surface of any prism, up to `reach`; Infinity without one.
  function castRay(prisms, o, d, reach) {
    const level = Math.hypot(d[0], d[1]);
    let first = Infinity;
    for (const prism of prisms) {
      const dx = prism.x - o[0], dy = prism.y - o[1];
      const along = dx * d[0] + dy * d[1];
      const near = level > 1e-12 ? Math.abs(dx * d[1] - dy * d[0]) / level : Math.hypot(dx, dy);
      if (near > prism.radius || along < -prism.radius) continue;
      let enter = -Infinity, leave = Infinity;
      if (Math.abs(d[2]) > 1e-12) {
        const a = (prism.low - o[2]) / d[2], b = (prism.high - o[2]) / d[2];
        enter = Math.min(a, b); leave = Math.max(a, b);
      } else if (o[2] < prism.low + 1e-6 || o[2] > prism.high - 1e-6) continue; // a ray along a face misses it
      for (const [nx, ny, c] of prism.sides) {
        const slope = nx * d[0] + ny * d[1], gap = c - nx * o[0] - ny * o[1];
        if (Math.abs(slope) < 1e-15) { if (gap < 0) { enter = Infinity; break; } continue; }
        const t = gap / slope;
        if (slope < 0) { if (t > enter) enter = t; } else if (t < leave) leave = t;
        if (enter > leave) break;
      }
      if (enter > leave || leave < 0) continue;
      const hit = enter >= 0 ? enter : leave;
      if (hit < first) first = hit;
    }
    return first <= reach ? first : Infinity;
  }

  // ---- lenses (trackers/cameras) -----------------------------------------------------------------------------------
  function inPicture(lens, u, v) {
    return u >= -0.5 && u <= lens.width - 0.5 && v >= -0.5 && v <= lens.height - 0.5;
  }
  function foldRadius(lens) { // where the radial polynomial of a pinhole stops growing, on a fine grid of tangents
    const [k1, k2, , , k3] = lens.distortion;
    if (!k1 && !k2 && !k3) return Infinity;
    for (let r = 0, before = -1; r < 10; r += 1e-3) {
      const s = r * r, grown = r * (1 + s * (k1 + s * (k2 + s * k3)));
      if (grown < before) return r;
      before = grown;
    }
    return Infinity;
  }
  function project(lens, p) { // camera frame: x right, y down, z ahead [m]; returns [u, v, shown]
    if (lens.field_of_view_rad !== undefined) {
      const rho = Math.hypot(p[0], p[1]), theta = Math.atan2(rho, p[2]), s = theta * theta, [k1, k2, k3, k4] = lens.k;
      const scale = rho > 0 ? (theta * (1 + s * (k1 + s * (k2 + s * (k3 + s * k4))))) / rho : 0;
      const u = lens.fx * scale * p[0] + lens.cx, v = lens.fy * scale * p[1] + lens.cy;
      return [u, v, theta <= lens.field_of_view_rad / 2 && inPicture(lens, u, v)];
    }
    if (p[2] <= 0) return [NaN, NaN, false];
    const x = p[0] / p[2], y = p[1] / p[2], s = x * x + y * y, [k1, k2, p1, p2, k3] = lens.distortion;
    const radial = 1 + s * (k1 + s * (k2 + s * k3));
    const u = lens.fx * (x * radial + 2 * p1 * x * y + p2 * (s + 2 * x * x)) + lens.cx;
    const v = lens.fy * (y * radial + p1 * (s + 2 * y * y) + 2 * p2 * x * y) + lens.cy;
    if (lens.fold === undefined) lens.fold = foldRadius(lens);
    return [u, v, inPicture(lens, u, v) && Math.sqrt(s) < lens.fold];
  }
  function pxPerMetre(lens, p) { // across the line of sight at a point in the camera frame; 0 outside the picture
    const [u, v, shown] = project(lens, p);
    if (!shown) return 0;
    const length = Math.max(Math.hypot(p[2], p[0]), 1e-9); // ray × (0, 1, 0) = (−z, 0, x)
    const [u2, v2] = project(lens, [p[0] - (NUDGE_M * p[2]) / length, p[1], p[2] + (NUDGE_M * p[0]) / length]);
    return Math.hypot(u2 - u, v2 - v) / NUDGE_M;
  }

  // ---- coverage of the floor ---------------------------------------------------------------------------------------
  function inside(area, x, y) {
    let odd = false;
    for (let i = 0, j = area.length - 1; i < area.length; j = i++) {
      const [xi, yi] = area[i], [xj, yj] = area[j];
      if (yi > y !== yj > y && x < ((xj - xi) * (y - yi)) / (yj - yi) + xi) odd = !odd;
    }
    return odd;
  }
  function cellsOf(area, cell) { // centres, as `floor_cells`
    const low = [0, 1].map((axis) => Math.min(...area.map((each) => each[axis])));
    const high = [0, 1].map((axis) => Math.max(...area.map((each) => each[axis])));
    const cells = [];
    for (let x = low[0] + cell / 2; x < high[0]; x += cell) {
      for (let y = low[1] + cell / 2; y < high[1]; y += cell) if (inside(area, x, y)) cells.push([x, y]);
    }
    return cells;
  }
  function laserResolution(plan, sensor, cells) { // beams on a body at each cell; 0: hidden
    const { rotation, origin } = poseOf(sensor), field = sensor.field, n = field.beams;
    const half = (field.field_of_view_deg * rad) / 2, step = (2 * half) / (n - 1), reach = new Float64Array(n);
    for (let i = 0; i < n; i++) {
      const angle = -half + i * step;
      reach[i] = castRay(plan.solid, origin, apply(rotation, [Math.cos(angle), Math.sin(angle), 0]), field.range_max_m);
    }
    const width = origin[2] >= TRUNK_FROM_M ? TRUNK_M : LEGS_M;
    return cells.map(([x, y]) => {
      const local = applyTransposed(rotation, [x - origin[0], y - origin[1], 0]);
      const gap = Math.max(Math.hypot(local[0], local[1]), 0.05), halfBody = Math.atan2(width / 2, gap);
      const place = (Math.atan2(local[1], local[0]) + half) / step;
      if (place < -0.5 || place > n - 0.5 || gap > field.range_max_m) return 0;
      let free = 0;
      for (const sight of SIGHTS) {
        const beam = Math.min(Math.max(Math.round(place + (sight * halfBody) / step), 0), n - 1);
        if (reach[beam] >= gap) free++;
      }
      return ((2 * halfBody) / step) * (free / SIGHTS.length);
    });
  }
  function cameraResolution(plan, sensor, cells) { // pixels per metre at the plan's height; 0: hidden
    const { rotation, origin } = poseOf(sensor), lens = sensor.field.intrinsics;
    return cells.map(([x, y]) => {
      const way = [x - origin[0], y - origin[1], plan.height_m - origin[2]];
      const sharp = pxPerMetre(lens, applyTransposed(rotation, way));
      if (sharp <= 0) return 0;
      const gap = Math.hypot(...way);
      const met = castRay(plan.solid, origin, way.map((value) => value / gap), gap);
      return met < gap - NUDGE_M ? 0 : sharp;
    });
  }
  function resolution(plan, sensor, cells) {
    return sensor.kind === "laser" ? laserResolution(plan, sensor, cells) : cameraResolution(plan, sensor, cells);
  }
  function wanted(plan, sensor) { return sensor.kind === "laser" ? plan.beams : plan.px_per_m; }
  function floorShare(plan, sensor, cells) {
    const found = resolution(plan, sensor, cells), least = wanted(plan, sensor);
    return found.reduce((count, value) => count + (value >= least), 0) / Math.max(cells.length, 1);
  }

  // ---- the scenario as YAML ----------------------------------------------------------------------------------------
  function yamlOf(plan, sensors, original) {
    const numbers = (values) => `[${values.map((value) => +value.toFixed(4)).join(", ")}]`;
    const lines = [
      `# Save this as ${plan.saved_as}, then: ${plan.run_by}`,
      `extends: ${JSON.stringify(plan.extends)}`, `name: ${JSON.stringify(plan.name)}`, "sensors:",
    ];
    for (const before of original) {
      if (!sensors.some((each) => each.name === before.name)) lines.push(`  ${JSON.stringify(before.name)}: null`);
    }
    for (const sensor of sensors) {
      const before = original.find((each) => each.name === sensor.name);
      lines.push(`  ${JSON.stringify(sensor.name)}:`);
      if (!before || before.model !== sensor.model) {
        for (const [key, value] of Object.entries(sensor.model)) lines.push(`    ${key}: ${JSON.stringify(value)}`);
      }
      if (before) lines.push("    housing: null");
      if (sensor.kind === "laser") lines.push("    role: null"); // waist or knee, by the height
      lines.push(
        `    mount: {xyz: ${numbers(sensor.xyz)}, yaw_deg: ${+sensor.yaw_deg.toFixed(3)}, ` +
        `pitch_deg: ${+sensor.pitch_deg.toFixed(3)}, roll_deg: ${+sensor.roll_deg.toFixed(3)}}`,
      );
    }
    return lines.join("\n") + "\n";
  }

  function planOf(content) { return { ...content, solid: prepared(content.prisms) }; }
  return { planOf, cellsOf, resolution, floorShare, wanted, yamlOf, castRay, poseOf, rad };
})();
if (typeof module !== "undefined") module.exports = RoomPlan;
