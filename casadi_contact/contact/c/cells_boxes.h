/* Which boxes the moving body may touch, BOXES of them at once and in single precision: within a metre it is wrong by
 * 1e-4 mm at most, for which TOUCH leaves room. */
typedef float Eight __attribute__((vector_size(4 * BOXES)));
typedef int Choice __attribute__((vector_size(4 * BOXES)));

/* Parallelograms middle ± half[0] ± half[1] of the fixed frame [mm] and what lies within `beyond` of them; size: how
 * far they reach from their middles, below 0 where there is none. */
typedef struct {
  Eight middle[3], half[2][3], beyond, size;
} Boxes;

/* Of the field at a node: value, gradient, concavity M and clearance (contact/cells/source.py) */
typedef struct {
  float g, slope[3], concavity, clearance, unused[2];
} Tangent;

/* A pose: the moving frame's axes, and the origin of its body's grid, in the fixed frame */
typedef struct {
  float r[3][3], from[3];
} Place;

/* The boxes' middles from the nearest nodes of the tangents' grid, body axes; squares of these ways within the grid */
typedef struct {
  Eight away[3], square_within;
  int nodes[BOXES];
} Nearest;

#ifdef FIELD_TANGENTS
#if defined(__AVX__)
INLINE Eight most_of(Eight a, Eight b) { return _mm256_max_ps(a, b); }
INLINE Eight least_of(Eight a, Eight b) { return _mm256_min_ps(a, b); }
INLINE unsigned choice_bits(Choice mask) { return (unsigned)_mm256_movemask_ps((__m256)mask); }
#else
INLINE Eight choose(Choice mask, Eight a, Eight b) { return (Eight)((mask & (Choice)a) | (~mask & (Choice)b)); }
INLINE Eight most_of(Eight a, Eight b) { return choose(a > b, a, b); }
INLINE Eight least_of(Eight a, Eight b) { return choose(a < b, a, b); }
INLINE unsigned choice_bits(Choice mask) {
  unsigned bits = 0;
  for (int l = 0; l < BOXES; l++) bits |= (unsigned)(mask[l] & 1) << l;
  return bits;
}
#endif
INLINE Eight absolute(Eight x) { return most_of(x, -x); }
INLINE Eight sum3(const Eight a[3], const Eight b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* Eight rows become eight columns. */
INLINE void transpose_eight(const Eight row[8], Eight column[8]) {
  Eight part[2][4];
  for (int k = 0; k < 2; k++, row += 4) {
    const Eight a = MIXED(Choice, row[0], row[1], 0, 8, 1, 9, 4, 12, 5, 13);
    const Eight b = MIXED(Choice, row[2], row[3], 0, 8, 1, 9, 4, 12, 5, 13);
    const Eight c = MIXED(Choice, row[0], row[1], 2, 10, 3, 11, 6, 14, 7, 15);
    const Eight d = MIXED(Choice, row[2], row[3], 2, 10, 3, 11, 6, 14, 7, 15);
    part[k][0] = MIXED(Choice, a, b, 0, 1, 8, 9, 4, 5, 12, 13);
    part[k][1] = MIXED(Choice, a, b, 2, 3, 10, 11, 6, 7, 14, 15);
    part[k][2] = MIXED(Choice, c, d, 0, 1, 8, 9, 4, 5, 12, 13);
    part[k][3] = MIXED(Choice, c, d, 2, 3, 10, 11, 6, 7, 14, 15);
  }
  for (int k = 0; k < 4; k++) {
    column[k] = MIXED(Choice, part[0][k], part[1][k], 0, 1, 2, 3, 8, 9, 10, 11);
    column[4 + k] = MIXED(Choice, part[0][k], part[1][k], 4, 5, 6, 7, 12, 13, 14, 15);
  }
}

INLINE Place place_of(const double *pose, const Frame *frame) {
  Place place;
  for (int i = 0; i < 3; i++) {
    place.from[i] = (float)(pose[i] + dot3(frame->r[i], field_origin));
    for (int j = 0; j < 3; j++) place.r[i][j] = (float)frame->r[i][j];
  }
  return place;
}

/* Whether the root of a square exceeds x, or falls short of it: roots take long. */
INLINE Choice is_beyond(Eight square, Eight x) { return square > x * absolute(x); }
INLINE Choice is_below(Eight square, Eight x) { return square < x * absolute(x); }

INLINE void find_tangents(const Boxes *boxes, const Place *place, Nearest *found) {
  const int counts[3] = {FIELD_X, FIELD_Y, FIELD_Z}, rows[3] = {TANGENTS_X, TANGENTS_Y, TANGENTS_Z};
  const float spacing = (float)FIELD_SPACING, stride = (float)TANGENT_SPACING, whole = 12582912.0f;
  const Eight none = {0.0f};
  Eight from[3], from_edge[3], node = none;
  Choice nodes;
  for (int i = 0; i < 3; i++) from[i] = boxes->middle[i] - place->from[i];
  for (int i = 0; i < 3; i++) {
    const Eight q = place->r[0][i] * from[0] + place->r[1][i] * from[1] + place->r[2][i] * from[2];
    const Eight within = least_of(most_of(q, none + spacing), none + (float)(counts[i] - 2) * spacing);
    const Eight nearest = least_of((within * (1.0f / stride) + whole) - whole, none + (float)(rows[i] - 1));
    found->away[i] = q - nearest * stride, from_edge[i] = within - nearest * stride;
    node = node * (float)rows[i] + nearest;
  }
  found->square_within = sum3(from_edge, from_edge);
  nodes = __builtin_convertvector(node, Choice);
  memcpy(found->nodes, &nodes, sizeof nodes);
}

/* One bit for each box that the body may come within TOUCH of: by value, slope and concavity of the field at the node
 * nearest to its middle, or by what is clear around that (see contact/cells/source.py), without evaluating the spline.
 * nearest: what `find_tangents` found. */
INLINE unsigned may_touch(const Boxes *boxes, const double *pose, const Frame *frame, const Place *place,
                          const Nearest *nearest) {
  const Eight size = boxes->size, *away = nearest->away;
  Eight slope[3], row[8], tangent[8], least, square;
  for (int l = 0; l < BOXES; l++) memcpy(row + l, FIELD_TANGENTS + FIELD_INDEX[nearest->nodes[l]], sizeof(Eight));
  transpose_eight(row, tangent);
  square = sum3(away, away);
  least = tangent[0] + sum3(tangent + 1, away) - 0.5f * tangent[4] * (square + size * size);
  least -= (float)STEEPEST * boxes->beyond;
  for (int i = 0; i < 3; i++) tangent[1 + i] -= tangent[4] * away[i]; /* now at the middle */
  for (int i = 0; i < 3; i++) {
    slope[i] = place->r[i][0] * tangent[1] + place->r[i][1] * tangent[2] + place->r[i][2] * tangent[3];
  }
  for (int side = 0; side < 2; side++) least -= absolute(sum3(slope, boxes->half[side]));
  (void)pose, (void)frame;
  return choice_bits((is_beyond(square, (float)CONCAVITY_REACH - size) | (least <= (float)TOUCH)) &
                     ~is_below(nearest->square_within, tangent[5] - size) & (size >= 0.0f));
}
#else
INLINE Place place_of(const double *pose, const Frame *frame) {
  (void)pose, (void)frame;
  return (Place){{{0.0f}}, {0.0f}};
}

INLINE void find_tangents(const Boxes *boxes, const Place *place, Nearest *found) { (void)boxes, (void)place, (void)found; }

INLINE unsigned may_touch(const Boxes *boxes, const double *pose, const Frame *frame, const Place *place,
                          const Nearest *nearest) {
  unsigned bits = 0;
  for (int first = 0; first < BOXES; first += BLOCK) {
    const Lanes size = singles_at((const float *)&boxes->size + first);
    Lanes middle[3], q[3];
    Distance found;
    for (int i = 0; i < 3; i++) middle[i] = singles_at((const float *)(boxes->middle + i) + first);
    to_place(middle, pose, frame, q);
    distance_at(q, 1, &found);
    bits |= bits_of((found.g - (BODY_FIELD ? STEEPEST : 1.0) * size <= TOUCH) & (size >= 0.0)) << first;
  }
  (void)place, (void)nearest;
  return bits;
}
#endif
