/* Lines along which polar quadrature integrates, and the points on them: the formulas of contact/polar/lines.py. */
#define CAP_BLOCKS (CAP_LINES / BLOCK)
#define MOST(a, b) ((a) > (b) ? (a) : (b)) /* numbers of rays are multiples of BLOCK */
#define SECOND_BLOCKS (TORUS * RIM_RAYS / BLOCK) /* of a second spot */
#define LINE_BLOCKS (MOST(RAYS / BLOCK + 2 * (ARCS - 1) * CAP_BLOCKS, RIM_RAYS / BLOCK) + SECOND_BLOCKS)
#define ENDS (LINE_BLOCKS * GAUSS) /* blocks of points */

/* A block of lines on one arc's torus (OWN_ARC: each end's own): a piece dr stands for an area (width + spread r) dr. */
typedef struct {
  Lanes u, v, du, dv, edge, width, spread;
  Lanes inside; /* 0 where the rim ends the line, else 1 */
  int arc;
} Line;

typedef struct {
  int count, cut; /* cut: the rim ends some line */
  Line line[LINE_BLOCKS];
} Lines;

typedef struct {
  int count;
  struct {
    Lanes u, v, weight;
    int arc;
  } at[ENDS];
} Points;

/* Distance at which x + r dx, from between the bounds, reaches one of them */
INLINE Lanes box_distance(double low, double high, Lanes x, Lanes dx) {
  return larger_of(larger_of((low - x) / dx, (high - x) / dx), all(0.0));
}

INLINE Lanes rim_distance(const Surfaces *s, const Line *line) {
  const Lanes u = line->u, v = line->v, du = line->du, dv = line->dv;
  Lanes distance = box_distance(s->v_low, s->v_high, v, dv);
#if CURVED_RIM
  for (int i = 0; i < 2; i++) {
    const double side = i ? s->spread : -s->spread;
    const Lanes from_centre = u - side * s->offset;
    const Lanes a = du * du + side * side * dv * dv, b = du * from_centre + side * side * v * dv;
    const Lanes c = from_centre * from_centre - side * side * (s->radius * s->radius - v * v);
    const Mask meets = s->rho_sign < 0.0 ? (b < 0.0) & (b * b > a * c) : (b == b);
    const Lanes there = (s->rho_sign * root(larger_of(b * b - a * c, all(0.0))) - b) / a;
    distance = pick(meets, smaller_of(distance, larger_of(there, all(0.0))), distance);
  }
  return distance;
#else
  return smaller_of(distance, box_distance(s->u_low, s->u_high, u, du));
#endif
}

/* Slope of the distance from the body along (du, dv) in the chart */
INLINE Lanes rise_of(const Ray *ray, Lanes du, Lanes dv) {
  return du * (ray->gradient[0] - ray->n_x * ray->gradient[1]) + dv * (ray->gradient[2] - ray->n_z * ray->gradient[1]);
}

/* Where Newton's step of g = 0 along the lines leads from their edges; g there. */
INLINE Lanes newton_edge(const Surfaces *s, const Place *p, const Line *line, Lanes *g) {
  Ray ray;
  cast(s, p, line->u + line->edge * line->du, line->v + line->edge * line->dv, line->arc, AT_START, &ray);
  *g = ray.g;
  return line->edge - ray.g / larger_of(rise_of(&ray, line->du, line->dv), all(LEAST_RISE));
}

/* Edges by Newton's method between a point within the body and one beyond it. */
FUNCTION void bracket_edges(const Surfaces *s, const Place *p, Lanes reach, Line *line) {
  Lanes low = all(0.0), high = reach;
  for (int i = 0; i < BRACKET_STEPS; i++) {
    const Lanes edge = line->edge;
    Lanes g, moved = newton_edge(s, p, line, &g);
    low = pick(g < 0.0, edge, low), high = pick(g < 0.0, high, edge);
    moved = smaller_of(moved, reach);
    line->edge = pick((moved >= low) & (moved <= high), moved, 0.5 * (low + high));
  }
}

/* Newton's steps of all lines, at most half or twice as far as before; the largest part by which an edge has moved. */
INLINE Lanes step_edges(const Surfaces *s, const Place *p, const Lanes *reach, Lines *lines) {
  Lanes most = all(0.0);
  for (int j = 0; j < lines->count; j++) { /* blocks do not wait for one another */
    const Lanes edge = lines->line[j].edge;
    Lanes g;
    const Lanes moved = newton_edge(s, p, lines->line + j, &g);
    lines->line[j].edge = smaller_of(smaller_of(larger_of(moved, 0.5 * edge), 2.0 * edge), reach[j]);
    most = larger_of(most, size_of(lines->line[j].edge - edge) / larger_of(edge, all(LEAST_LENGTH)));
  }
  return most;
}

/* Edges, so far estimates, by Newton's method of g = 0, or where the rim ends the lines. */
INLINE void find_edges(const Surfaces *s, const Place *p, Lines *lines) {
  Lanes reach[LINE_BLOCKS], moved = all(0.0);
  for (int j = 0; j < lines->count; j++) {
    reach[j] = rim_distance(s, lines->line + j);
    lines->line[j].edge = smaller_of(lines->line[j].edge, reach[j]);
  }
  for (int i = 0; i < EDGE_STEPS; i++) moved = step_edges(s, p, reach, lines);
  if (any(moved > EDGE_TOLERANCE)) step_edges(s, p, reach, lines);
  if (any(moved > BRACKET_FROM)) {
    for (int j = 0; j < lines->count; j++) bracket_edges(s, p, reach[j], lines->line + j);
  }
  lines->cut = 0;
  for (int j = 0; j < lines->count; j++) {
    const Line *line = lines->line + j;
    lines->line[j].inside = pick(line->edge < reach[j], all(1.0), all(0.0));
    lines->cut |= any((line->edge >= reach[j]) & ((line->width != 0.0) | (line->spread != 0.0)));
  }
}

/* Area by distance at the edges, none where the rim ends the lines */
INLINE Lanes edge_width(const Line *line) { return (line->width + line->spread * line->edge) * line->inside; }

/* Gauss points on every line */
INLINE void place_points(const Lines *lines, Points *points) {
  points->count = 0;
  for (int g = 0; g < GAUSS; g++) {
    for (int j = 0; j < lines->count; j++) {
      const Line *line = lines->line + j;
      const Lanes r = line->edge * gauss_x[g];
      points->at[points->count].u = line->u + r * line->du;
      points->at[points->count].v = line->v + r * line->dv;
      points->at[points->count].weight = line->edge * gauss_w[g] * (line->width + line->spread * r);
      points->at[points->count++].arc = line->arc;
    }
  }
}

/* Rays from the middle of a spot: the formulas of contact/polar/lines.py. */
#define FULL_TURN 6.283185307179586

INLINE void add_rays(const Middle *middle, Lines *lines) {
  const Spot *m = &middle->spot;
  const int count = middle->whole ? RAYS : RIM_RAYS;
  const double *cosine = middle->whole ? ray_cos : rim_cos, *sine = middle->whole ? ray_sin : rim_sin;
  for (int j = 0; j < count / BLOCK; j++) {
    const Lanes c = lanes_at(cosine + j * BLOCK), d = lanes_at(sine + j * BLOCK);
    const Lanes du = middle->form[0][0] * c + middle->form[0][1] * d, dv = middle->form[1][0] * c + middle->form[1][1] * d;
    const Lanes slope = m->slope[0] * du + m->slope[1] * dv;
    const Lanes k = m->curvature[0] * du * du + 2.0 * m->curvature[1] * du * dv + m->curvature[2] * dv * dv;
    Line *line = lines->line + lines->count++;
    line->u = all(m->u), line->v = all(m->v), line->du = du, line->dv = dv;
    line->edge = edge_of(all(larger(m->depth, 0.0)), slope, k);
    line->width = all(0.0), line->spread = all(FULL_TURN / count), line->arc = middle->whole ? m->arc : OWN_ARC;
  }
}
