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

/* Distance and gradient (fixed frame) at up to four points: gradient[l] is (g, G). */
FUNCTION void distances(const double *points[BLOCK], const double *pose, const Frame *frame, double found[BLOCK][4],
                      double bow[BLOCK]) {
  Lanes q[3];
  Distance at;
  for (int l = 0; l < BLOCK; l++) {
    double place[3];
    place_of(points[l], pose, frame, place);
    bow[l] = bow_at(place);
    for (int i = 0; i < 3; i++) q[i][l] = place[i];
  }
  distance_at(q, 1, &at);
  for (int l = 0; l < BLOCK; l++) {
    found[l][0] = at.g[l];
    for (int i = 0; i < 3; i++) {
      found[l][1 + i] = frame->r[i][0] * at.slope[0][l] + frame->r[i][1] * at.slope[1][l] + frame->r[i][2] * at.slope[2][l];
    }
  }
}

/* What g is at least over a box `half` about `offset` from a point where it is known: if that is near the surface: by
 * its slope there and its bow, or by its steepest slope anywhere. */
INLINE double least_distance(const double known[4], double bow, const double offset[3], const double half[3]) {
  double reach[3], tangent = known[0], away = 0.0, farthest;
  for (int i = 0; i < 3; i++) {
    reach[i] = fabs(offset[i]) + half[i];
    tangent += known[1 + i] * offset[i] - fabs(known[1 + i]) * half[i];
    away += reach[i] * reach[i];
  }
  farthest = known[0] - STEEPEST * sqrt(away);
  tangent -= 0.5 * bow * away;
  return bow < 0.0 || away > BOW_REACH * BOW_REACH || farthest > tangent ? farthest : tangent;
}

/* Blocks whose cells may come within `margin` of the body, by one number of the field each where there is one. */
INLINE int near_blocks(const Patch *p, const double *pose, const Frame *frame, double margin, int *found) {
  int count = 0;
  for (int b = 0; b < p->block_count; b++) {
#if BODY_FIELD
    double place[3];
    long long node;
    place_of(p->blocks[b].middle, pose, frame, place);
    node = nearest_node(place);
    if (node >= 0 && FIELD_COEFFICIENTS[node] > margin + NODE_REACH + steepest_reach(p->blocks[b].half)) continue;
#endif
    found[count++] = b;
  }
  (void)pose, (void)frame, (void)margin;
  return count;
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
  static const double nowhere[3] = {0.0, 0.0, 0.0};
  int blocks[MOST_BLOCKS + BLOCK];
  const int count = near_blocks(p, pose, frame, TOUCH, blocks);
  s->nodes = s->cells = 0;
  if (++s->turn == 0) memset(s->seen, 0, sizeof s->seen), s->turn = 1;
  for (int k = count; k % BLOCK; k++) blocks[k] = blocks[count - 1];
  for (int first = 0; first < count; first += BLOCK) {
    const double *points[BLOCK];
    double known[BLOCK][4], bow[BLOCK];
    for (int l = 0; l < BLOCK; l++) points[l] = p->blocks[blocks[first + l]].middle;
    distances(points, pose, frame, known, bow);
    for (int l = 0; l < BLOCK && first + l < count; l++) {
      const Block *block = p->blocks + blocks[first + l];
      if (least_distance(known[l], bow[l], nowhere, block->half) > TOUCH) continue;
      for (int c = block->first; c < block->last; c++) {
        const Cell *cell = p->cells + c;
        const double offset[3] = {cell->middle[0] - block->middle[0], cell->middle[1] - block->middle[1],
                                  cell->middle[2] - block->middle[2]};
        if (least_distance(known[l], bow[l], offset, cell->half) > TOUCH) continue;
        want_corners(s, cell);
        s->chosen[s->cells++] = c;
      }
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
