/* The cells of a patch that may touch in a pose, and what their corners are like. */
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
  const unsigned char *known;           /* nodes within the rim */
  const double (*present)[SUB_POINTS]; /* 1 at sub-points on the surface: of whole cells, then of those at the rim */
  int node_count, block_count;
} Patch;

/* Loads of a patch, not yet faded, as those of `Node` (force, moment, area), and their derivatives by twist in the axes
 * of the moving body */
typedef struct {
  double loads[7];
  Lanes by_twist[7][2]; /* six of the eight numbers */
  int cut;
} Sums;

/* Of one patch in one pose; one for each thread, since it would not fit on every stack. */
typedef struct {
  int nodes, cells, full, ids[MOST_NODES + BLOCK], chosen[MOST_CELLS + BLOCK], groups[MOST_GROUPS];
  int slot[MOST_NODES]; /* of a node in what follows; holds where seen[node] is the present turn */
  unsigned seen[MOST_NODES], turn;
  int again[MOST_NODES + BLOCK], agains; /* slots that are worth a second look, */
  int is_again[MOST_NODES + BLOCK];      /* and whether they are */
  Sums sums;
  double value[MOST_NODES + BLOCK][BLOCK] __attribute__((aligned(64))); /* three, and the depth found at the node */
  double weight[MOST_NODES + BLOCK][BLOCK];
  double slopes[MOST_NODES + BLOCK][3][2 * BLOCK], share[MOST_NODES + BLOCK][2 * BLOCK];
} Scratch;
static __thread Scratch scratch __attribute__((aligned(64)));

INLINE Scratch *own_scratch(void) {
  Scratch *s = &scratch;
  __asm__("" : "+r"(s)); /* else the thread's address is asked for at each use */
  return s;
}

/* Distance at four points of the fixed frame */
FUNCTION void distances(const Lanes points[3], const double *pose, const Frame *frame, Lanes *found) {
  Lanes q[3];
  Distance at;
  to_place(points, pose, frame, q);
  distance_at(q, 1, &at);
  *found = at.g;
}

INLINE void want_corners(Scratch *s, const Cell *cell) {
  for (int k = 0; k < 4; k++) {
    const int node = cell->corners[k];
    if (s->seen[node] == s->turn) continue;
    s->seen[node] = s->turn, s->is_again[s->nodes] = 0, s->slot[node] = s->nodes, s->ids[s->nodes++] = node;
  }
}

INLINE void begin_turn(Scratch *s) {
  s->nodes = s->cells = 0;
  if (++s->turn == 0) memset(s->seen, 0, sizeof s->seen), s->turn = 1;
}

/* Fill `chosen` with the cells that may touch, and `ids` with their corners. */
FUNCTION void choose_cells(const Patch *p, const double *pose, const Frame *frame, Scratch *s) {
  int groups = 0;
  begin_turn(s);
  KEEP_LOOP for (int b = 0; b < p->block_count; b += BLOCK) {
    const Mask near = may_touch(p->block_boxes + b / BLOCK, pose, frame);
    KEEP_LOOP for (int l = 0; l < BLOCK; l++) {
      for (int k = p->blocks[b + l].first; near[l] && k < p->blocks[b + l].last; k++) s->groups[groups++] = k;
    }
  }
  KEEP_LOOP for (int g = 0; g < groups; g++) {
    const Mask touch = may_touch(p->cell_boxes + s->groups[g], pose, frame);
    KEEP_LOOP for (int l = 0; l < BLOCK; l++) {
      const int cell = BLOCK * s->groups[g] + l;
      if (!touch[l]) continue;
      want_corners(s, p->cells + cell);
      s->chosen[s->cells++] = cell;
    }
  }
}

/* Values in four slots, where the depth found at the nodes themselves is `first`; with order 2 derivatives by twist. */
INLINE void fill_slots(const Patch *p, const int *slots, Lanes first, const double *pose, const Frame *frame, int order,
                       Scratch *s) {
  int ids[BLOCK];
  Lanes row[BLOCK], column[BLOCK], slopes[3][6];
  Depth at;
  for (int l = 0; l < BLOCK; l++) ids[l] = s->ids[slots[l]];
  depth_at(p->nodes, ids, first, pose, frame, order, &at);
  for (int i = 0; i < 3; i++) row[i] = at.value[i];
  row[3] = any(first != 0.0) ? first : pick(at.sigma > FLATTEST + FLATTEST_WIDTH, at.d, all(0.0));
  transpose(row, column);
  for (int l = 0; l < BLOCK; l++) memcpy(s->value[slots[l]], column + l, sizeof column[l]);
  if (order < 2) return;
  value_slopes(&at, frame, slopes);
  for (int i = 0; i < 3; i++) {
    const Lanes rest[BLOCK] = {slopes[i][4], slopes[i][5], all(0.0), all(0.0)};
    Lanes others[BLOCK];
    transpose(slopes[i], column);
    transpose(rest, others);
    for (int l = 0; l < BLOCK; l++) {
      memcpy(s->slopes[slots[l]][i], column + l, sizeof column[l]);
      memcpy(s->slopes[slots[l]][i] + BLOCK, others + l, sizeof others[l]);
    }
  }
}

INLINE void corner_values(const Patch *p, const Scratch *s, const int *chosen, Lanes v[12]) {
  for (int c = 0; c < 4; c++) {
    Lanes row[BLOCK], column[BLOCK];
    for (int l = 0; l < BLOCK; l++) row[l] = lanes_at(s->value[s->slot[p->cells[chosen[l]].corners[c]]]);
    transpose(row, column);
    for (int i = 0; i < 3; i++) v[3 * c + i] = column[i];
  }
}

/* Keep only cells whose interpolated depth can exceed -WIDTH - spare; those in which it exceeds WIDTH everywhere come
 * first, `full` of them. A cubic lies within the hull of its Bezier points: the corners' values and a third of their
 * slopes further in. */
FUNCTION void sort_cells(const Patch *p, double spare, Scratch *s) {
  const int count = s->cells;
  s->cells = s->full = 0;
  for (int k = count; k % BLOCK; k++) s->chosen[k] = s->chosen[count - 1];
  for (int k = 0; k < count; k += BLOCK) {
    Lanes v[12], highest, lowest;
    int chosen[BLOCK];
    memcpy(chosen, s->chosen + k, sizeof chosen);
    corner_values(p, s, chosen, v);
    for (int c = 0; c < 4; c++) {
      const Lanes along_u = (c < 2 ? 1.0 : -1.0) / 3.0 * v[3 * c + 1];
      const Lanes along_v = (c % 2 ? -1.0 : 1.0) / 3.0 * v[3 * c + 2];
      const Lanes high = v[3 * c] + larger_of(along_u, all(0.0)) + larger_of(along_v, all(0.0));
      const Lanes low = v[3 * c] + smaller_of(along_u, all(0.0)) + smaller_of(along_v, all(0.0));
      highest = c ? larger_of(highest, high) : high, lowest = c ? smaller_of(lowest, low) : low;
    }
    for (int l = 0; l < BLOCK && k + l < count; l++) {
      if (highest[l] <= -WIDTH - spare) continue;
      s->chosen[s->cells] = chosen[l];
      if (!LOGARITHMIC && lowest[l] > WIDTH && p->cells[chosen[l]].present == 0) {
        s->chosen[s->cells] = s->chosen[s->full], s->chosen[s->full++] = chosen[l];
      }
      s->cells++;
    }
  }
}

/* A look at all corners; another, with derivatives if asked for, at those of cells that matter. */
INLINE void fill_nodes(const Patch *p, const double *pose, const Frame *frame, int order, Scratch *s) {
  for (int k = s->nodes; k % BLOCK; k++) s->ids[k] = s->ids[s->nodes - 1];
  for (int first = 0; first < s->nodes; first += BLOCK) {
    const int slots[BLOCK] = {first, first + 1, first + 2, first + 3};
    fill_slots(p, slots, all(0.0), pose, frame, 1, s);
  }
  sort_cells(p, SPARE, s);
  s->agains = 0;
  for (int k = 0; k < s->cells; k++) {
    for (int c = 0; c < 4; c++) {
      const int slot = s->slot[p->cells[s->chosen[k]].corners[c]];
      if (s->is_again[slot] || (order < 2 && fabs(s->value[slot][3]) <= SMALL_DEPTH - SMALL_DEPTH_WIDTH)) continue;
      s->is_again[slot] = 1, s->again[s->agains++] = slot;
    }
  }
  for (int k = s->agains; k % BLOCK; k++) s->again[k] = s->again[s->agains - 1];
  for (int k = 0; k < s->agains; k += BLOCK) {
    Lanes first;
    for (int l = 0; l < BLOCK; l++) first[l] = s->value[s->again[k + l]][3];
    fill_slots(p, s->again + k, first, pose, frame, order, s);
  }
  sort_cells(p, 0.0, s);
}
