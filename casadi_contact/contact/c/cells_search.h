/* The cells of a patch that may touch in a pose, and what their corners are like. */
typedef struct {
  double middle[3], half[3]; /* box around the surface of the cell, sub-points and all */
  int corners[4], present, rim;
} Cell;

typedef struct {
  double middle[3], half[3];
  int first, last; /* cells */
} Block;

typedef struct {
  const Node *nodes;
  const Cell *cells;
  const Block *blocks;
  const unsigned char *known;           /* nodes within the rim */
  const double (*present)[SUB_POINTS]; /* 1 at sub-points on the surface: of whole cells, then of those at the rim */
  int node_count, block_count;
} Patch;

/* Of one patch in one pose; one for each thread, since it would not fit on every stack. */
typedef struct {
  int nodes, cells, ids[MOST_NODES + BLOCK], chosen[MOST_CELLS + BLOCK];
  int slot[MOST_NODES]; /* of a node in what follows; holds where seen[node] is the present turn */
  unsigned seen[MOST_NODES], turn;
  double value[MOST_NODES + BLOCK][4], weight[MOST_NODES + BLOCK][4];
  double slopes[MOST_NODES + BLOCK][3][2 * BLOCK] __attribute__((aligned(64)));
} Scratch;
static __thread Scratch scratch __attribute__((aligned(64)));

INLINE double steepest_reach(const double half[3]) {
  return STEEPEST * sqrt(half[0] * half[0] + half[1] * half[1] + half[2] * half[2]);
}

INLINE void place_of(const double point[3], const double *pose, const Frame *frame, double q[3]) {
  for (int j = 0; j < 3; j++) {
    q[j] = 0.0;
    for (int i = 0; i < 3; i++) q[j] += frame->r[i][j] * (point[i] - pose[i]);
  }
}

/* Distance at four points of the fixed frame */
FUNCTION void distances(const double *points[BLOCK], const double *pose, const Frame *frame, double found[BLOCK]) {
  Lanes q[3];
  Distance at;
  for (int l = 0; l < BLOCK; l++) {
    double place[3];
    place_of(points[l], pose, frame, place);
    for (int i = 0; i < 3; i++) q[i][l] = place[i];
  }
  distance_at(q, 1, &at);
  for (int l = 0; l < BLOCK; l++) found[l] = at.g[l];
}

INLINE void want_corners(Scratch *s, const Cell *cell) {
  for (int k = 0; k < 4; k++) {
    const int node = cell->corners[k];
    if (s->seen[node] == s->turn) continue;
    s->seen[node] = s->turn, s->slot[node] = s->nodes, s->ids[s->nodes++] = node;
  }
}

/* Fill `chosen` with the cells that may touch, and `ids` with their corners. */
FUNCTION void choose_cells(const Patch *p, const double *pose, const Frame *frame, Scratch *s) {
  s->nodes = s->cells = 0;
  if (++s->turn == 0) memset(s->seen, 0, sizeof s->seen), s->turn = 1;
  for (int b = 0; b < p->block_count; b++) {
    const Block *block = p->blocks + b;
    double place[3];
    place_of(block->middle, pose, frame, place);
    if (!may_touch(place, block->half, frame)) continue;
    for (int c = block->first; c < block->last; c++) {
      const Cell *cell = p->cells + c;
      place_of(cell->middle, pose, frame, place);
      if (!may_touch(place, cell->half, frame)) continue;
      want_corners(s, cell);
      s->chosen[s->cells++] = c;
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
