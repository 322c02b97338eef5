/* Layers for LANES poses at once: a[j][lane] -> z[o][lane]. Vectors run over poses, so that nothing is filled up; LANES is
 * a multiple of VECTOR. Sums of so many outputs as registers hold are made together: each input is read once for all. */
#define IN_LANES (LANES / VECTOR)

#if defined(__AVX512F__)
#define OUTPUTS_AT_ONCE 4
#elif defined(__AVX__)
#define OUTPUTS_AT_ONCE 2
#else
#define OUTPUTS_AT_ONCE 1
#endif

#define EACH_OUTPUT UNROLL for (int o = 0; o < outputs; o++)
#define EACH_VECTOR UNROLL for (int v = 0; v < IN_LANES; v++)

INLINE void lanes_block(int inputs, int outputs, int stride, const double *w, const double *a, double *z) {
  const Vector zero = {0};
  Vector sum[OUTPUTS_AT_ONCE][IN_LANES], input[IN_LANES];
  EACH_OUTPUT EACH_VECTOR sum[o][v] = zero + w[o];
  for (int j = 0; j < inputs; j++) {
    const double *row = w + (j + 1) * stride;
    EACH_VECTOR input[v] = loaded(a + j * LANES + v * VECTOR);
    EACH_OUTPUT EACH_VECTOR sum[o][v] += input[v] * row[o];
  }
  EACH_OUTPUT EACH_VECTOR *(Stored *)(z + o * LANES + v * VECTOR) = sum[o][v];
}

/* z = W a + b; stride is the padded number of outputs */
INLINE void lanes(int inputs, int outputs, int stride, const double *w, const double *a, double *z) {
  int o = 0;
  for (; o + OUTPUTS_AT_ONCE <= outputs; o += OUTPUTS_AT_ONCE) {
    lanes_block(inputs, OUTPUTS_AT_ONCE, stride, w + o, a, z + o * LANES);
  }
  for (; OUTPUTS_AT_ONCE > 1 && o < outputs; o++) lanes_block(inputs, 1, stride, w + o, a, z + o * LANES);
}

/* One output, whose bias lies elsewhere. */
INLINE void lanes_out(int inputs, const double *w, double bias, const double *a, double *y) {
  const Vector zero = {0};
  Vector sum[IN_LANES];
  EACH_VECTOR sum[v] = zero + bias;
  for (int j = 0; j < inputs; j++) EACH_VECTOR sum[v] += loaded(a + j * LANES + v * VECTOR) * w[j];
  EACH_VECTOR *(Stored *)(y + v * VECTOR) = sum[v];
}
