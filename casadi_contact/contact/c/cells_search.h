/* The cells of a patch that may touch in a pose. */
typedef struct {
  int corners[4], present, rim;
} Cell;

typedef struct {
  int first, last; /* of its boxes of cells */
} Block;

typedef struct {
  const Node *nodes;
  const Cell *cells;        /* as many as there are in boxes: none where these are none */
  const Boxes *cell_boxes;  /* around their surface, sub-points and all */
  const Boxes *block_boxes; /* around the surface of blocks */
  const Block *blocks;
  const unsigned char *known;          /* nodes within the rim */
  const double (*present)[SUB_POINTS]; /* share of the surface at sub-points: of whole cells, then of others */
  int block_count;
} Patch;

/* Loads of a patch, not yet faded, as of `Node` (force, moment, area), and derivatives by twist in body axes */
#define PARTS (8 / BLOCK)
typedef struct {
  double loads[8];
  Lanes by_twist[7][PARTS]; /* six of the eight numbers */
  int cut;
} Sums;

/* Of a patch in one pose; one for each thread, since it would not fit on every stack. Kept: an optimiser asks for
 * value, Jacobian and Hessian in one pose after the other. What is found does not depend on what was asked before. */
typedef struct {
  double pose[VARIABLES]; /* in which cells were chosen, where `searched`; `filled`: the order of what nodes and sums hold */
  int searched, filled;
  int nodes, ids[MOST_NODES + BLOCK]; /* evaluated: a slot each in what follows */
  unsigned mark[MOST_NODES], turn;    /* of a node: turn and slot; below the present turn before that */
  int groups[MOST_GROUPS];
  Nearest nearest[MOST_GROUPS + MOST_BLOCKS];
  unsigned touched[MOST_GROUPS + MOST_BLOCKS];
  int near, near_cells[MOST_CELLS + BLOCK]; /* cells that may touch, */
  int corners[MOST_CELLS + BLOCK][4];          /* the slots of their corners, */
  int cells, full, chosen[MOST_CELLS + BLOCK]; /* and which of these cells matter */
  unsigned left[MOST_CELLS / BLOCK + 1], some[MOST_CELLS / BLOCK + 1]; /* of near cells, one bit each: see the loops */
  int again_count, again[MOST_NODES + BLOCK]; /* slots that need a second evaluation, */
  int again_order[MOST_NODES];              /* and of which order they had one */
  Sums sums;
  double value[MOST_NODES + BLOCK][4] __attribute__((aligned(64))); /* three, and -g at the node */
  double overlap[MOST_NODES + BLOCK], node_slope[3][MOST_NODES + BLOCK]; /* -g and the gradient of g at the node */
  Spot spots[MOST_NODES / BLOCK + 1];
  double weight[MOST_NODES + BLOCK][4];
  double slopes[MOST_NODES + BLOCK][3][8], share[MOST_NODES + BLOCK][8];
#if MOVING
  double rubbed[MOST_NODES + BLOCK][8]; /* loads of nodes, as those of `Node` */
#endif
} Scratch;
static __thread Scratch scratch[PATCHES] __attribute__((aligned(64)));

INLINE Scratch *own_scratch(int patch) {
  Scratch *s = scratch + patch;
  __asm__("" : "+r"(s)); /* else the thread's address is asked for at each use */
  return s;
}

/* Distance at BLOCK points of the fixed frame */
FUNCTION void distances(const Lanes points[3], const double *pose, const Frame *frame, Lanes *found) {
  Lanes q[3];
  Distance at;
  to_place(points, pose, frame, q);
  distance_at(q, 1, &at);
  *found = at.g;
}

INLINE void begin_turn(Scratch *s) {
  if (s->turn >= UINT_MAX - 2 * MOST_NODES) memset(s->mark, 0, sizeof s->mark), s->turn = 0;
  s->turn += MOST_NODES;
}

/* Filled up with the last one, to whole lanes */
INLINE void fill_up(int *ids, int count) {
  for (int k = count; k % BLOCK; k++) ids[k] = ids[count - 1];
}

/* Slots of a cell's corners, new ones for those not seen this turn; how many are then taken. Without branches. */
INLINE int take_slots(Scratch *s, const Cell *cell, int taken, int slots[4]) {
  const unsigned turn = s->turn;
  for (int k = 0; k < 4; k++) {
    const int node = cell->corners[k];
    const unsigned mark = s->mark[node], fresh = mark < turn, now = fresh ? turn + (unsigned)taken : mark;
    s->ids[taken] = node, s->mark[node] = now, slots[k] = (int)(now - turn);
    taken += (int)fresh;
  }
  return taken;
}

/* Which boxes may touch, of those chosen or of all. Each loop asks for what the next one waits for. */
FUNCTION void test_boxes(const Boxes *boxes, const int *chosen, int count, const double *pose, const Frame *frame,
                            Scratch *s) {
  const Place place = place_of(pose, frame);
  KEEP_LOOP for (int k = 0; k < count; k++) find_tangents(boxes + (chosen ? chosen[k] : k), &place, s->nearest + k);
  KEEP_LOOP for (int k = 0; k < count; k++) {
    s->touched[k] = may_touch(boxes + (chosen ? chosen[k] : k), pose, frame, &place, s->nearest + k);
  }
}

/* Fill `near_cells` with the cells that may touch, and `ids` and `corners` with their corners. */
FUNCTION void find_cells(const Patch *p, const double *pose, const Frame *frame, Scratch *s) {
  int groups = 0, near = 0, nodes = 0;
  begin_turn(s);
  test_boxes(p->block_boxes, 0, (p->block_count + BOXES - 1) / BOXES, pose, frame, s);
  KEEP_LOOP for (int b = 0; b < p->block_count; b += BOXES) {
    KEEP_LOOP for (unsigned left = s->touched[b / BOXES]; left; left &= left - 1) {
      const Block *block = p->blocks + b + first_bit(left);
      for (int k = block->first; k < block->last; k++) s->groups[groups++] = k;
    }
  }
  test_boxes(p->cell_boxes, s->groups, groups, pose, frame, s);
  KEEP_LOOP for (int g = 0; g < groups; g++) {
    for (int l = 0; l < BOXES; l++) s->near_cells[near] = BOXES * s->groups[g] + l, near += s->touched[g] >> l & 1;
  }
  KEEP_LOOP for (int k = 0; k < near; k++) nodes = take_slots(s, p->cells + s->near_cells[k], nodes, s->corners[k]);
  s->near = near, s->nodes = nodes;
  fill_up(s->ids, nodes);
}
