/* Sums over the layers of a network in NUMBERs, for WORKED_ON rows of data at once. Included once for each precision.
 *
 * A block holds so many rows: for each layer its inputs, the constant one last, and then its derivatives, what takes a
 * change of the layer's z to the network's output; a number of each row. */
#define Rows OF(Rows)
typedef NUMBER Rows __attribute__((vector_size(sizeof(NUMBER) * WORKED_ON), aligned(sizeof(NUMBER)), may_alias));

/* z[i][b] = sum_j weights[i across + j along] inputs[b][j] of some neurons i and blocks b, each a constant where this
 * is inlined */
INLINE void OF(products)(const int neurons, const int blocks, int width, int vectors, int across, int along,
                         const NUMBER *weights, const Rows *inputs, Rows z[TILE_NEURONS][TILE_BLOCKS]) {
  for (int i = 0; i < neurons; i++)
    for (int b = 0; b < blocks; b++) z[i][b] = (Rows){0};
  for (int j = 0; j < width; j++)
    for (int i = 0; i < neurons; i++)
      for (int b = 0; b < blocks; b++) z[i][b] += weights[i * across + j * along] * inputs[b * vectors + j];
}

INLINE void OF(add_tangents)(const int neurons, const int blocks, int width, int vectors, const NUMBER *weights,
                             const Rows *inputs, const Rows *derivatives, Rows *sums) {
  Rows z[TILE_NEURONS][TILE_BLOCKS];
  OF(products)(neurons, blocks, width, vectors, width, 1, weights, inputs, z);
  for (int i = 0; i < neurons; i++)
    for (int b = 0; b < blocks; b++) sums[b] += z[i][b] * derivatives[b * vectors + i];
}

/* J v: change of the output with the direction's weights, of some blocks */
INLINE void OF(tangents)(const Shape *of, const int blocks, const NUMBER *direction, const Rows *block, Rows *sums) {
  for (int b = 0; b < blocks; b++) sums[b] = (Rows){0};
  for (int l = 0; l < of->layers; l++) {
    const int width = of->widths[l], neurons = of->neurons[l];
    const Rows *derivatives = block + width;
    int i = 0;
    for (; i + TILE_NEURONS <= neurons; i += TILE_NEURONS)
      OF(add_tangents)(TILE_NEURONS, blocks, width, of->vectors, direction + i * width, block, derivatives + i, sums);
    for (; i < neurons; i++)
      OF(add_tangents)(1, blocks, width, of->vectors, direction + i * width, block, derivatives + i, sums);
    direction += neurons * width;
    block = derivatives + neurons;
  }
}

/* totals[i][j] += sum_b effects[b] derivatives[b][i] inputs[b][j] of some neurons i and inputs j */
INLINE void OF(add_products)(const int neurons, const int inputs_at_once, int blocks, int width, int vectors,
                             const Rows *effects, const Rows *inputs, const Rows *derivatives, Rows *totals) {
  Rows sums[TILE_NEURONS][MOST_INPUTS];
  for (int i = 0; i < neurons; i++)
    for (int j = 0; j < inputs_at_once; j++) sums[i][j] = totals[i * width + j];
  for (int b = 0; b < blocks; b++)
    for (int i = 0; i < neurons; i++) {
      const Rows by = effects[b] * derivatives[b * vectors + i];
      for (int j = 0; j < inputs_at_once; j++) sums[i][j] += by * inputs[b * vectors + j];
    }
  for (int i = 0; i < neurons; i++)
    for (int j = 0; j < inputs_at_once; j++) totals[i * width + j] = sums[i][j];
}

/* Inputs in as few shares of a constant size as there may be, none of them small */
INLINE void OF(add_neurons)(const int neurons, int blocks, int width, int vectors, const Rows *effects,
                            const Rows *inputs, const Rows *derivatives, Rows *totals) {
  int shares = (width + MOST_INPUTS - 1) / MOST_INPUTS;
  for (int j = 0, size; j < width; j += size, shares--) {
    size = (width - j) / shares;
#define ADD(n) \
  case n: \
    OF(add_products)(neurons, n, blocks, width, vectors, effects, inputs + j, derivatives, totals + j); \
    break
    switch (size) {
      ADD(1);
      ADD(2);
#if MOST_INPUTS > 2
      ADD(3);
      ADD(4);
      ADD(5);
      ADD(6);
#endif
    }
#undef ADD
  }
}

/* J^T u: totals[parameter] += sum of the output's changes with it, times effects, of some blocks; lanes are kept apart */
INLINE void OF(add_reverse)(const Shape *of, int blocks, const Rows *effects, const Rows *block, Rows *totals) {
  for (int l = 0; l < of->layers; l++) {
    const int width = of->widths[l], neurons = of->neurons[l];
    const Rows *derivatives = block + width;
    int i = 0;
    for (; i + TILE_NEURONS <= neurons; i += TILE_NEURONS)
      OF(add_neurons)(TILE_NEURONS, blocks, width, of->vectors, effects, block, derivatives + i, totals + i * width);
    for (; i < neurons; i++)
      OF(add_neurons)(1, blocks, width, of->vectors, effects, block, derivatives + i, totals + i * width);
    totals += neurons * width;
    block = derivatives + neurons;
  }
}
#undef Rows
#undef NUMBER
#undef WORKED_ON
