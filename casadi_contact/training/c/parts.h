/* Networks of a patch's parts in training: sizes of what the processor works on at once, and the rows it reads. */
#include <stdint.h>

#define JOINED_(name, number) name##_##number
#define JOINED(name, number) JOINED_(name, number)
#define OF(name) JOINED(name, NUMBER)
#if defined(__AVX512F__)
#define LANES 16 /* rows of a block in single precision: those of a register */
#define TILE_NEURONS 4 /* and below: as many sums as stay in registers */
#define TILE_BLOCKS 4  /* 2 at least */
#define MOST_INPUTS 6  /* of a layer, at once */
#else
#define LANES 8
#define TILE_NEURONS 4
#define TILE_BLOCKS 2
#define MOST_INPUTS 2
#endif
#define HALF (LANES / 2) /* the same in double precision */

typedef struct {
  int layers, parameters, vectors; /* vectors: of a block */
  const int *neurons, *widths;     /* of each layer; of its inputs, the constant one too */
} Shape;

typedef struct {
  Shape shape;
  int part;
  const int64_t *first; /* (groups + 1) blocks */
  const int32_t *row;   /* (blocks, LANES) within the group, -1: none */
  const double *inputs; /* (2 blocks, inputs, HALF), scaled, without the constant one */
  float *factors;       /* (blocks, vectors, LANES) */
} Piece;
