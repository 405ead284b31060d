// The outline of an insole around its taxels: dilated by discs and eroded, so that gaps between patches close.

const SWEPT_MM = 58, SHRUNK_MM = 50, STEP_MM = 1;
const ROUNDED = 9, ROUNDS = 3; // neighbours on each side that a point is averaged with, and how often

// A closed line [[x, y], …] in mm, from points [[x, y], …] in mm; x is along the foot.
export function outline(points) {
  const xs = points.map(([x]) => x);
  const first = Math.min(...xs) - SWEPT_MM, rows = Math.ceil((Math.max(...xs) + SWEPT_MM - first) / STEP_MM) + 1;
  const edge = (side) => {
    const swept = Array.from({ length: rows }, (_, row) => {
      const x = first + row * STEP_MM;
      return Math.max(...points.map(([px, py]) => reach(x - px, SWEPT_MM) + side * py));
    });
    const reachRows = Math.ceil(SHRUNK_MM / STEP_MM);
    return swept.map((_, row) => {
      let least = Infinity;
      for (let other = row - reachRows; other <= row + reachRows; other++) {
        const shrink = reach((other - row) * STEP_MM, SHRUNK_MM);
        if (shrink > -Infinity) least = Math.min(least, (swept[other] ?? -Infinity) - shrink);
      }
      return least;
    });
  };
  const left = edge(1), right = edge(-1);
  let line = [];
  const inside = left.map((value, row) => value > -right[row]);
  for (let row = 0; row < rows; row++) if (inside[row]) line.push([first + row * STEP_MM, left[row]]);
  for (let row = rows - 1; row >= 0; row--) if (inside[row]) line.push([first + row * STEP_MM, -right[row]]);
  for (let round = 0; round < ROUNDS; round++) line = rounded(line);
  return line;
}

function rounded(line) {
  const side = Array.from({ length: 2 * ROUNDED + 1 }, (_, i) => i - ROUNDED);
  const mean = (at, axis) => side.reduce((sum, step) => sum + line.at((at + step) % line.length)[axis], 0) / side.length;
  return line.map((_, at) => [mean(at, 0), mean(at, 1)]);
}

function reach(distance, radius) {
  return Math.abs(distance) > radius ? -Infinity : Math.sqrt(radius * radius - distance * distance);
}

// The smallest convex line around points, counter-clockwise (Andrew's monotone chain).
export function hull(points) {
  const sorted = [...points].sort(([ax, ay], [bx, by]) => ax - bx || ay - by);
  const half = (ordered) => {
    const line = [];
    for (const point of ordered) {
      while (line.length > 1 && turn(line.at(-2), line.at(-1), point) <= 0) line.pop();
      line.push(point);
    }
    return line.slice(0, -1);
  };
  return [...half(sorted), ...half(sorted.reverse())];
}

function turn([ax, ay], [bx, by], [cx, cy]) {
  return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
}
