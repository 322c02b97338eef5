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

/* Of one patch in one pose; one for each thread, since it would not fit on every stack. */
typedef struct {
  int nodes, cells, ids[MOST_NODES + BLOCK], chosen[MOST_CELLS + BLOCK], groups[MOST_GROUPS];
  int slot[MOST_NODES]; /* of a node in what follows; holds where seen[node] is the present turn */
  unsigned seen[MOST_NODES], turn;
  double value[MOST_NODES + BLOCK][4], weight[MOST_NODES + BLOCK][4];
  double slopes[MOST_NODES + BLOCK][3][2 * BLOCK] __attribute__((aligned(64)));
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
    s->seen[node] = s->turn, s->slot[node] = s->nodes, s->ids[s->nodes++] = node;
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

/* Values at the wanted nodes, and with order 2 their derivatives by twist. */
INLINE void fill_nodes(const Patch *p, const double *pose, const Frame *frame, int order, Scratch *s) {
  for (int k = s->nodes; k % BLOCK; k++) s->ids[k] = s->ids[s->nodes - 1];
  for (int first = 0; first < s->nodes; first += BLOCK) {
    Lanes slopes[3][6];
    Depth at;
    depth_at(p->nodes, s->ids + first, pose, frame, order, &at);
    if (order >= 2) value_slopes(&at, slopes);
    for (int l = 0; l < BLOCK; l++) {
      for (int i = 0; i < 3; i++) {
        s->value[first + l][i] = at.value[i][l];
        for (int a = 0; a < 6 && order >= 2; a++) s->slopes[first + l][i][a] = slopes[i][a][l];
      }
    }
  }
}

/* Keep only cells whose interpolated depth can exceed -WIDTH: those all of whose sub-points exceed WIDTH come first.
 * Between its corners a cubic lies within a quarter of the slopes of the corners' values. Returns how many are full. */
FUNCTION int sort_cells(const Patch *p, Scratch *s) {
  int kept = 0, full = 0;
  for (int k = 0; k < s->cells; k++) {
    const Cell *cell = p->cells + s->chosen[k];
    double highest = -1e300, lowest = 1e300, slope_u = 0.0, slope_v = 0.0, bow;
    for (int j = 0; j < 4; j++) {
      const double *v = s->value[s->slot[cell->corners[j]]];
      highest = v[0] > highest ? v[0] : highest, lowest = v[0] < lowest ? v[0] : lowest;
      slope_u = fabs(v[1]) > slope_u ? fabs(v[1]) : slope_u, slope_v = fabs(v[2]) > slope_v ? fabs(v[2]) : slope_v;
    }
    bow = 0.25 * (slope_u + slope_v);
    if (highest + bow <= -WIDTH) continue;
    s->chosen[kept] = s->chosen[k];
    if (!LOGARITHMIC && lowest - bow > WIDTH && cell->present == 0) {
      const int swapped = s->chosen[full];
      s->chosen[full++] = s->chosen[kept], s->chosen[kept] = swapped;
    }
    kept++;
  }
  s->cells = kept;
  return full;
}
