// Interactive plan: coverage of the floor by sensors that the reader drags, turns and exchanges.
// Computes what twin/studies/visibility.py does; frames, units and names are those of the package.
"use strict";
const RoomPlan = (() => {
  const TRUNK_M = 0.35, LEGS_M = 0.2, TRUNK_FROM_M = 0.7, NUDGE_M = 0.01, OUTLINE_M = 0.05, SIGHTS = [-2 / 3, 0, 2 / 3];
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

  // ---- places and prices -------------------------------------------------------------------------------------------
  const within = (prism, [x, y, z]) => z > prism.low && z < prism.high && prism.sides.every(([nx, ny, c]) => nx * x + ny * y < c);
  function footOn(ring, x, y) { // nearest point of a closed line: distance, and how far along the line it is [m]
    let best = { gap: Infinity }, past = 0;
    ring.forEach(([ax, ay], i) => {
      const [bx, by] = ring[(i + 1) % ring.length], dx = bx - ax, dy = by - ay, length = Math.hypot(dx, dy);
      const share = length ? Math.min(Math.max(((x - ax) * dx + (y - ay) * dy) / length ** 2, 0), 1) : 0;
      const gap = Math.hypot(ax + share * dx - x, ay + share * dy - y);
      if (gap < best.gap) best = { gap, along: past + share * length };
      past += length;
    });
    return { ...best, around: past };
  }
  function cableLength(plan, xyz) { // as `cable_route`: along the walls, over doorways in the way
    const { start, straight, doors } = plan.constraints.cable;
    if (straight) return Math.hypot(...start.map((value, axis) => xyz[axis] - value));
    const first = footOn(plan.outline, start[0], start[1]), last = footOn(plan.outline, xyz[0], xyz[1]), { around } = first;
    const turn = (value) => ((value % around) + around) % around;
    return first.gap + last.gap + Math.abs(xyz[2] - start[2]) + Math.min(...[[first.along, 1], [last.along, -1]].map(([begin, way]) => {
      const length = turn((last.along - first.along) * way);
      const passed = doors.filter(([low, high]) => [-1, 0, 1].some((n) => {
        const middle = (low + high) / 2 + n * around;
        return begin < middle && middle < begin + length;
      }));
      return length + 2 * Math.max(0, ...passed.map((each) => each[2] - Math.max(start[2], xyz[2])));
    }));
  }
  function cableTo(plan, device, sensors) { // to its farthest sensor: itself, or one that it carries
    const held = sensors.filter((each) => each !== device && each.device === device.device && !each.is_device);
    return Math.max(...[device, ...held].map((each) => cableLength(plan, each.xyz)));
  }
  function faultsOf(plan, sensor, sensors) { // why a sensor must not be where it is
    const rules = plan.constraints, [x, y, z] = sensor.xyz, faults = [];
    if (z < 0) faults.push("below the floor");
    if ([...plan.solid, ...plan.panes].some((each) => within(each, sensor.xyz))) faults.push("inside a thing of the room");
    else if (!inside(plan.outline, x, y) && footOn(plan.outline, x, y).gap > OUTLINE_M) faults.push("outside the building");
    if (!sensor.is_device) return faults;
    for (const zone of rules.zones) {
      if (inside(zone.corners, x, y) && z >= zone.from_m && z <= (zone.to_m ?? Infinity)) faults.push(`in the zone ${zone.name}`);
    }
    if (rules.walkable && z < rules.walked_below_m && inside(rules.walkable, x, y) && rules.obstacles.every(
      (each) => !inside(each, x, y) && footOn(each, x, y).gap > rules.obstacle_reach_m)) faults.push(`lower than ${rules.walked_below_m} m where people walk`);
    for (const other of sensors) {
      const gap = Math.hypot(...sensor.xyz.map((value, axis) => value - other.xyz[axis]));
      if (other !== sensor && other.is_device && gap < Math.max(rules.apart_m ?? 0, 1e-6) - 1e-9) {
        faults.push(`${gap.toFixed(2)} m from ${other.name}, at least ${rules.apart_m} m is expected`);
      }
    }
    const most = rules.cable?.most_m, length = most ? cableTo(plan, sensor, sensors) : 0;
    if (most && length > most) faults.push(`${length.toFixed(1)} m of cable, at most ${most} m is expected`);
    return faults;
  }
  function priceOf(plan, sensors) { // of devices and cables; null where nothing costs anything
    const { cable } = plan.constraints, devices = sensors.filter((each) => each.is_device);
    if (!cable?.price_per_m && devices.every((each) => each.price === null)) return null;
    return devices.reduce((sum, each) => sum + each.price + (cable ? cable.price_per_m * cableTo(plan, each, sensors) : 0), 0);
  }
  function placeBeside(plan, sensor, sensors) { // the nearest free place: around a sensor, or as far off the walls as it is
    const [x, y, z] = sensor.xyz, ring = plan.outline, places = [];
    for (const gap of [0.5, 1, 1.5, 2, 3, 4]) for (let turn = 0; turn < 360; turn += 30) {
      places.push([x + gap * Math.cos(turn * rad), y + gap * Math.sin(turn * rad)]);
    }
    const { gap: off } = footOn(ring, x, y);
    ring.forEach(([ax, ay], i) => {
      const [bx, by] = ring[(i + 1) % ring.length], length = Math.hypot(bx - ax, by - ay), way = [(bx - ax) / length, (by - ay) / length];
      for (let along = off; along <= length - off; along += 0.25) places.push([ax + along * way[0] - off * way[1], ay + along * way[1] + off * way[0]]);
    });
    const found = places.map(([u, v]) => {
      const xyz = [Math.round(u * 100) / 100, Math.round(v * 100) / 100, z];
      return { xyz, faults: faultsOf(plan, { ...sensor, xyz }, sensors).length, gap: Math.hypot(u - x, v - y) };
    }).filter((each) => each.gap > 0.3);
    return found.sort((a, b) => a.faults - b.faults || a.gap - b.gap)[0].xyz;
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
    const unchanged = lines.length;
    for (const sensor of sensors) {
      const before = original.find((each) => each.name === sensor.name), role = roleOf(plan, sensor);
      const mount = `    mount: {xyz: ${numbers(sensor.xyz)}, yaw_deg: ${+sensor.yaw_deg.toFixed(3)}, ` +
        `pitch_deg: ${+sensor.pitch_deg.toFixed(3)}, roll_deg: ${+sensor.roll_deg.toFixed(3)}}`;
      const isSame = before && JSON.stringify(before.model) === JSON.stringify(sensor.model);
      if (isSame && JSON.stringify(pose(before)) === JSON.stringify(pose(sensor))) continue; // as in the file that it extends
      lines.push(`  ${JSON.stringify(sensor.name)}:`);
      if (!isSame) {
        for (const [key, value] of Object.entries(sensor.model)) lines.push(`    ${key}: ${JSON.stringify(value)}`);
        const gone = before?.kind === sensor.kind ? Object.keys(before.model).filter((key) => !(key in sensor.model)) : [];
        for (const key of gone) lines.push(`    ${key}: null`);
      }
      if (before?.is_housed) lines.push("    housing: null");
      if (sensor.kind === "laser" && role !== (before?.kind === "laser" ? before.role : null)) lines.push(`    role: ${role}`);
      lines.push(mount);
    }
    if (lines.length === unchanged && lines[unchanged - 1] === "sensors:") lines[unchanged - 1] += " {}";
    return lines.join("\n") + "\n";
  }
  const pose = ({ xyz, yaw_deg, pitch_deg, roll_deg }) => [xyz, yaw_deg, pitch_deg, roll_deg];
  function roleOf(plan, sensor) { // the sensor's own, while its height and tilt allow; raised or lowered, that of its layer
    const tilt = Math.acos(Math.min(1, Math.abs(rotationOf(sensor)[2][2]))) / rad;
    if (!sensor.role || tilt > plan.most_tilt_deg + 1e-6) return null;
    const layer = (z) => (z >= plan.waist_from_m ? "waist" : "knee");
    return layer(sensor.xyz[2]) === layer(sensor.role_z) ? sensor.role : layer(sensor.xyz[2]);
  }

  function planOf(content) {
    const sensors = content.sensors.map((each) => ({ ...each, role_z: each.xyz[2] })); // the height that its role is of
    return { ...content, sensors, solid: prepared(content.prisms), panes: prepared(content.glass) };
  }
  return { planOf, cellsOf, resolution, floorShare, wanted, yamlOf, castRay, poseOf, rad, inside, faultsOf, priceOf, placeBeside };
})();
if (typeof module !== "undefined") module.exports = RoomPlan;
