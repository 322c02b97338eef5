/* Outputs and gradients in double, J^T J v in single precision.
 *
 * Rows of data lie in groups; those of a part that matter lie in blocks of LANES, those of the first group first. A
 * group is small enough for J v and J^T to read its blocks from memory once. */

int lanes_of_a_block(void) { return LANES; }

INLINE void layer_forward(const int neurons, int width, int vectors, const double *weights, const Rows_double *inputs,
                          Rows_double *z) {
  Rows_double sums[TILE_NEURONS][TILE_BLOCKS];
  products_double(neurons, 2, width, vectors, width, 1, weights, inputs, sums);
  for (int i = 0; i < neurons; i++)
    for (int b = 0; b < 2; b++) z[b * vectors + i] = sums[i][b];
}

INLINE void layer_backward(const int neurons, int after, int width, int vectors, const double *weights,
                           const Rows_double *later, Rows_double *slopes) {
  Rows_double sums[TILE_NEURONS][TILE_BLOCKS];
  products_double(neurons, 2, after, vectors, 1, width, weights, later, sums);
  for (int i = 0; i < neurons; i++)
    for (int b = 0; b < 2; b++) slopes[b * vectors + i] *= sums[i][b];
}

/* Fill the inputs of all layers of two half blocks, and in place of their derivatives the sigmoids' slopes; of the last
 * the output */
INLINE void run_forward(const Shape *of, const double *weights, const double *inputs, Rows_double *block) {
  const int given = of->widths[0] - 1, last = of->layers - 1, vectors = of->vectors;
  for (int b = 0; b < 2; b++) memcpy(block + b * vectors, inputs + b * given * HALF, sizeof(Rows_double) * given);
  for (int l = 0; l <= last; l++) {
    const int width = of->widths[l], neurons = of->neurons[l];
    Rows_double *derivatives = block + width, *next = derivatives + neurons, *z = l < last ? next : derivatives;
    int i = 0;
    block[width - 1] = block[vectors + width - 1] = 1.0 - (Rows_double){0};
    for (; i + TILE_NEURONS <= neurons; i += TILE_NEURONS)
      layer_forward(TILE_NEURONS, width, vectors, weights + i * width, block, z + i);
    for (; i < neurons; i++) layer_forward(1, width, vectors, weights + i * width, block, z + i);
    if (l < last)
      for (int b = 0; b < 2; b++)
        SIGMOIDS(neurons * HALF, (double *)(next + b * vectors), (double *)(derivatives + b * vectors));
    weights += neurons * width;
    block = next;
  }
}

/* The slopes of two half blocks become derivatives of the one output */
INLINE void run_backward(const Shape *of, const double *weights, Rows_double *block) {
  int ends[MOST_LAYERS + 1], starts[MOST_LAYERS + 1];
  ends[0] = starts[0] = 0;
  for (int l = 0; l < of->layers; l++) {
    ends[l + 1] = ends[l] + of->neurons[l] + of->widths[l];
    starts[l + 1] = starts[l] + of->neurons[l] * of->widths[l];
  }
  block[ends[of->layers] - 1] = block[of->vectors + ends[of->layers] - 1] = 1.0 - (Rows_double){0};
  for (int l = of->layers - 2; l >= 0; l--) {
    const int after = of->neurons[l + 1], width = of->widths[l + 1];
    const double *w = weights + starts[l + 1];
    Rows_double *slopes = block + ends[l] + of->widths[l];
    const Rows_double *later = block + ends[l + 1] + width;
    int i = 0;
    for (; i + TILE_NEURONS <= of->neurons[l]; i += TILE_NEURONS)
      layer_backward(TILE_NEURONS, after, width, of->vectors, w + i, later, slopes + i);
    for (; i < of->neurons[l]; i++) layer_backward(1, after, width, of->vectors, w + i, later, slopes + i);
  }
}

INLINE const double *inputs_of(const Piece *piece, int64_t half) {
  return piece->inputs + half * (piece->shape.widths[0] - 1) * HALF;
}

/* outputs (blocks, LANES); room: of two half blocks */
void outputs_of(const Piece *piece, int64_t blocks, const double *weights, double *outputs, double *room) {
  const Shape *of = &piece->shape;
  for (int64_t h = 0; h < 2 * blocks; h += 2) {
    run_forward(of, weights, inputs_of(piece, h), (Rows_double *)room);
    for (int b = 0; b < 2; b++)
      memcpy(outputs + (h + b) * HALF, room + ((b + 1) * of->vectors - 1) * HALF, HALF * sizeof(double));
  }
}

INLINE void keep_single(const Piece *piece, int64_t half, const double *block) {
  const int vectors = piece->shape.vectors;
  float *kept = piece->factors + half / 2 * vectors * LANES + half % 2 * HALF;
  for (int v = 0; v < vectors; v++)
    for (int n = 0; n < HALF; n++) kept[v * LANES + n] = (float)block[v * HALF + n];
}

/* Factors at these weights; gradient (parameters, HALF) += J^T effects, effects (blocks, LANES).
 * room: of MOST_BLOCKS half blocks */
void move_to(const Piece *piece, int64_t blocks, const double *weights, const double *effects, double *gradient,
             double *room) {
  const Shape *of = &piece->shape;
  for (int64_t h = 0; h < 2 * blocks; h += MOST_BLOCKS) {
    const int count = 2 * blocks - h < MOST_BLOCKS ? (int)(2 * blocks - h) : MOST_BLOCKS;
    for (int k = 0; k < count; k += 2) {
      double *block = room + k * of->vectors * HALF;
      run_forward(of, weights, inputs_of(piece, h + k), (Rows_double *)block);
      run_backward(of, weights, (Rows_double *)block);
      for (int b = 0; b < 2; b++) keep_single(piece, h + k + b, block + b * of->vectors * HALF);
    }
    add_reverse_double(of, count, (const Rows_double *)(effects + h * HALF), (const Rows_double *)room,
                       (Rows_double *)gradient);
  }
}

/* What a change of the roots (parts) does to the residuals of LANES rows, and these back to the roots, in place:
 * roots[k] <- slopes[k] sum_j shares[k][j] (sum_k' shares[k'][j] slopes[k'] roots[k']) + squares[k] roots[k] */
INLINE void through_residuals(int parts, int residuals, const Rows_float *shares, const Rows_float *slopes,
                              const Rows_float *squares, Rows_float *roots) {
  Rows_float change[MOST_RESIDUALS];
  for (int j = 0; j < residuals; j++) change[j] = (Rows_float){0};
  for (int k = 0; k < parts; k++) {
    const Rows_float load = slopes[k] * roots[k];
    for (int j = 0; j < residuals; j++) change[j] += shares[k * residuals + j] * load;
  }
  for (int k = 0; k < parts; k++) {
    Rows_float sum = {0};
    for (int j = 0; j < residuals; j++) sum += shares[k * residuals + j] * change[j];
    roots[k] = slopes[k] * sum + squares[k] * roots[k];
  }
}

/* Roots of a group lie as (rows / LANES, parts, LANES) */
INLINE int place_of(int row, int part, int parts) { return (row / LANES * parts + part) * LANES + row % LANES; }

INLINE void add_roots(const Piece *piece, int64_t first, int64_t end, int parts, const float *direction, float *roots) {
  const Shape *of = &piece->shape;
  const Rows_float *factors = (const Rows_float *)piece->factors;
  for (int64_t b = first; b < end;) {
    Rows_float sums[TILE_BLOCKS];
    const int count = end - b < TILE_BLOCKS ? 1 : TILE_BLOCKS;
    if (count == TILE_BLOCKS) tangents_float(of, TILE_BLOCKS, direction, factors + b * of->vectors, sums);
    else tangents_float(of, 1, direction, factors + b * of->vectors, sums);
    for (int n = 0; n < count * LANES; n++) {
      const int row = piece->row[b * LANES + n];
      if (row >= 0) roots[place_of(row, piece->part, parts)] = sums[n / LANES][n % LANES];
    }
    b += count;
  }
}

INLINE void add_group(const Piece *piece, int64_t first, int64_t end, int parts, const float *roots, float *totals) {
  const Shape *of = &piece->shape;
  for (int64_t b = first; b < end; b += MOST_BLOCKS) {
    Rows_float effects[MOST_BLOCKS];
    const int count = end - b < MOST_BLOCKS ? (int)(end - b) : MOST_BLOCKS;
    for (int n = 0; n < count * LANES; n++) {
      const int row = piece->row[b * LANES + n];
      effects[n / LANES][n % LANES] = row < 0 ? 0.0f : roots[place_of(row, piece->part, parts)];
    }
    add_reverse_float(of, count, effects, (const Rows_float *)piece->factors + b * of->vectors, (Rows_float *)totals);
  }
}

/* totals of each piece (parameters, LANES) += J^T J v, v its direction (parameters). Of all rows: shares (rows / LANES,
 * parts, residuals, LANES), slopes and squares (rows / LANES, parts, LANES); roots: room for those of a group. The way
 * back begins with the pieces that were read last. */
void gram_product(int count, const Piece *pieces, int64_t rows, int group_rows, int parts, int residuals,
                  const float *shares, const float *slopes, const float *squares, const float *const *directions,
                  float *const *totals, float *roots) {
  int64_t g = 0;
  for (int64_t start = 0; start < rows; start += group_rows, g++) {
    const int here = rows - start < group_rows ? (int)(rows - start) : group_rows;
    memset(roots, 0, sizeof(float) * (size_t)(group_rows * parts));
    for (int p = 0; p < count; p++)
      add_roots(pieces + p, pieces[p].first[g], pieces[p].first[g + 1], parts, directions[p], roots);
    for (int n = 0; n < here; n += LANES) {
      const int64_t at = (start + n) * parts;
      through_residuals(parts, residuals, (const Rows_float *)(shares + at * residuals), (const Rows_float *)(slopes + at),
                        (const Rows_float *)(squares + at), (Rows_float *)(roots + n * parts));
    }
    for (int p = count - 1; p >= 0; p--)
      add_group(pieces + p, pieces[p].first[g], pieces[p].first[g + 1], parts, roots, totals[p]);
  }
}
