/** The pixels that a flat surface of triangles covers: values at its points become colours without drawing a triangle. */

export class Covered {
  /** flat: points (right, up), place: to pixels; of a picture `wide` × `high` pixels. */
  constructor({ flat, corners }, place, wide, high) {
    const owner = new Int32Array(wide * high).fill(-1);
    const share = new Float32Array(2 * wide * high);
    for (let k = 0; k < corners.length; k += 3) {
      const [a, b, c] = [0, 1, 2].map((j) => place([flat[2 * corners[k + j]], flat[2 * corners[k + j] + 1]]));
      within(a, b, c, wide, high, (pixel, toB, toC) => {
        owner[pixel] = k;
        share[2 * pixel] = toB;
        share[2 * pixel + 1] = toC;
      });
    }
    this.pixels = Uint32Array.from(owner.keys()).filter((pixel) => owner[pixel] >= 0);
    this.points = new Uint32Array(3 * this.pixels.length);
    this.shares = new Float32Array(2 * this.pixels.length);
    this.pixels.forEach((pixel, i) => {
      this.points.set(corners.subarray(owner[pixel], owner[pixel] + 3), 3 * i);
      this.shares.set(share.subarray(2 * pixel, 2 * pixel + 2), 2 * i);
    });
  }

  /** Paint pixels where the values, linear between the points, are above zero; paint: by their share of the largest. */
  paint(picture, values, paint, largest) {
    const { pixels, points, shares } = this;
    const steps = (paint.length - 1) / largest;
    for (let i = 0; i < pixels.length; i++) {
      const [a, toB, toC] = [values[points[3 * i]], shares[2 * i], shares[2 * i + 1]];
      const value = a + toB * (values[points[3 * i + 1]] - a) + toC * (values[points[3 * i + 2]] - a);
      if (value > 0) picture[pixels[i]] = paint[Math.min(Math.round(value * steps), paint.length - 1)];
    }
  }
}

/** Each pixel whose middle lies in a triangle, with the shares of its second and third corner there. */
function within([ax, ay], [bx, by], [cx, cy], wide, high, found) {
  const twice = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
  if (twice === 0) return;
  const range = (parts, end) => [
    Math.max(0, Math.ceil(Math.min(...parts) - 0.5)),
    Math.min(end - 1, Math.floor(Math.max(...parts) - 0.5)),
  ];
  const [left, right] = range([ax, bx, cx], wide);
  const [top, bottom] = range([ay, by, cy], high);
  for (let row = top; row <= bottom; row++) {
    for (let column = left; column <= right; column++) {
      const [x, y] = [column + 0.5 - ax, row + 0.5 - ay];
      const toB = (x * (cy - ay) - y * (cx - ax)) / twice;
      const toC = (y * (bx - ax) - x * (by - ay)) / twice;
      if (toB >= 0 && toC >= 0 && toB + toC <= 1) found(row * wide + column, toB, toC);
    }
  }
}
