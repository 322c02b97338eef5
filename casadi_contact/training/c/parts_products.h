/* Outputs and gradients in double, J^T J v in single precision.
 *
 * Rows of data lie in groups; those of a part that matter lie in blocks of LANES, those of the first group first. A
 * group is small enough for J v and J^T to read its blocks from memory once. */

int lanes_of_a_block(void) { return LANES; }

/* Fill a block's inputs of all layers, and in place of their derivatives the sigmoids' slopes; of the last the output */
INLINE void run_forward(const Shape *of, const double *weights, const double *inputs, Rows_double *block) {
  const int given = of->widths[0] - 1, last = of->layers - 1;
  memcpy(block, inputs, sizeof(Rows_double) * given);
  for (int l = 0; l <= last; l++) {
    const int width = of->widths[l], neurons = of->neurons[l];
    Rows_double *derivatives = block + width, *next = derivatives + neurons, *z = l < last ? next : derivatives;
    int i = 0;
    block[width - 1] = 1.0 - (Rows_double){0};
    for (; i + TILE_NEURONS <= neurons; i += TILE_NEURONS)
      layer_double(TILE_NEURONS, width, weights + i * width, block, z + i);
    for (; i < neurons; i++) layer_double(1, width, weights + i * width, block, z + i);
    if (l < last) SIGMOIDS(neurons * HALF, (double *)next, (double *)derivatives);
    weights += neurons * width;
    block = next;
  }
}

/* The slopes of a block become derivatives of the one output */
INLINE void run_backward(const Shape *of, const double *weights, Rows_double *block) {
  int ends[MOST_LAYERS + 1], starts[MOST_LAYERS + 1];
  ends[0] = starts[0] = 0;
  for (int l = 0; l < of->layers; l++) {
    ends[l + 1] = ends[l] + of->neurons[l] + of->widths[l];
    starts[l + 1] = starts[l] + of->neurons[l] * of->widths[l];
  }
  block[ends[of->layers] - 1] = 1.0 - (Rows_double){0};
  for (int l = of->layers - 2; l >= 0; l--) {
    const int after = of->neurons[l + 1], width = of->widths[l + 1];
    const double *w = weights + starts[l + 1];
    Rows_double *slopes = block + ends[l] + of->widths[l];
    const Rows_double *later = block + ends[l + 1] + width;
    for (int i = 0; i < of->neurons[l]; i++) {
      Rows_double even = {0}, odd = {0};
      int m = 0;
      for (; m + 1 < after; m += 2) {
        even += w[m * width + i] * later[m];
        odd += w[(m + 1) * width + i] * later[m + 1];
      }
      if (m < after) even += w[m * width + i] * later[m];
      slopes[i] *= even + odd;
    }
  }
}

INLINE const double *inputs_of(const Piece *piece, int64_t half) {
  return piece->inputs + half * (piece->shape.widths[0] - 1) * HALF;
}

/* outputs (blocks, LANES); room: of a half block */
void outputs_of(const Piece *piece, int64_t blocks, const double *weights, double *outputs, double *room) {
  const Shape *of = &piece->shape;
  for (int64_t h = 0; h < 2 * blocks; h++) {
    run_forward(of, weights, inputs_of(piece, h), (Rows_double *)room);
    memcpy(outputs + h * HALF, room + (of->vectors - 1) * HALF, HALF * sizeof(double));
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
    for (int k = 0; k < count; k++) {
      double *block = room + k * of->vectors * HALF;
      run_forward(of, weights, inputs_of(piece, h + k), (Rows_double *)block);
      run_backward(of, weights, (Rows_double *)block);
      keep_single(piece, h + k, block);
    }
    add_reverse_double(of, count, (const Rows_double *)(effects + h * HALF), (const Rows_double *)room,
                       (Rows_double *)gradient);
  }
}

/* What a change of a row's roots (parts) does to its residuals, and these back to the roots, in place:
 * roots[k] <- sum_j slopes[k][j] (sum_k' slopes[k'][j] roots[k']) + squares[k] roots[k] */
INLINE void through_residuals(int parts, int residuals, const float *slopes, const float *squares, float *roots) {
  float change[MOST_RESIDUALS] = {0.0f};
  for (int k = 0; k < parts; k++)
    for (int j = 0; j < residuals; j++) change[j] += slopes[k * residuals + j] * roots[k];
  for (int k = 0; k < parts; k++) {
    float sum = squares[k] * roots[k];
    for (int j = 0; j < residuals; j++) sum += slopes[k * residuals + j] * change[j];
    roots[k] = sum;
  }
}

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
      if (row >= 0) roots[row * parts + piece->part] = sums[n / LANES][n % LANES];
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
      effects[n / LANES][n % LANES] = row < 0 ? 0.0f : roots[row * parts + piece->part];
    }
    add_reverse_float(of, count, effects, (const Rows_float *)piece->factors + b * of->vectors, (Rows_float *)totals);
  }
}

/* totals of each piece (parameters, LANES) += J^T J v, v its direction (parameters). slopes (rows, parts, residuals) and
 * squares (rows, parts) of all rows' residuals; roots: room for those of a group (group_rows, parts) */
void gram_product(int count, const Piece *pieces, int64_t rows, int group_rows, int parts, int residuals,
                  const float *slopes, const float *squares, const float *const *directions, float *const *totals,
                  float *roots) {
  int64_t g = 0;
  for (int64_t start = 0; start < rows; start += group_rows, g++) {
    const int here = rows - start < group_rows ? (int)(rows - start) : group_rows;
    memset(roots, 0, sizeof(float) * (size_t)(here * parts));
    for (int p = 0; p < count; p++)
      add_roots(pieces + p, pieces[p].first[g], pieces[p].first[g + 1], parts, directions[p], roots);
    for (int n = 0; n < here; n++, slopes += parts * residuals, squares += parts)
      through_residuals(parts, residuals, slopes, squares, roots + n * parts);
    for (int p = 0; p < count; p++)
      add_group(pieces + p, pieces[p].first[g], pieces[p].first[g + 1], parts, roots, totals[p]);
  }
}
