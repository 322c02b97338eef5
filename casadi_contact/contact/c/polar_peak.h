/* The rim of a patch and the point nearest to the body: the formulas of contact/polar/surfaces.py and peak.py. */

/* u = w s(v): in (w, v) the rim is a box */
INLINE void box_of(const Surfaces *s, double low[2], double high[2]) {
  low[0] = CURVED_RIM ? -s->spread : s->u_low, high[0] = CURVED_RIM ? s->spread : s->u_high;
  low[1] = s->v_low, high[1] = s->v_high;
}

/* s(v) with its first and second derivative */
INLINE void stretch_of(const Surfaces *s, double v, double stretch[3]) {
#if CURVED_RIM
  const double tube = sqrt(s->radius * s->radius - v * v);
  stretch[0] = s->offset + s->rho_sign * tube;
  stretch[1] = -s->rho_sign * v / tube;
  stretch[2] = -s->rho_sign * s->radius * s->radius / (tube * tube * tube);
#else
  (void)s, (void)v;
  stretch[0] = 1.0, stretch[1] = stretch[2] = 0.0;
#endif
}

INLINE void u_range(const Surfaces *s, double v, double *low, double *high) {
  double least[2], most[2], stretch[3];
  box_of(s, least, most);
  stretch_of(s, v, stretch);
  *low = least[0] * stretch[0], *high = most[0] * stretch[0];
}

INLINE void within(const Surfaces *s, double *u, double *v) {
  double low, high;
  *v = bounded_by(*v, s->v_low, s->v_high);
  u_range(s, *v, &low, &high);
  *u = bounded_by(*u, low, high);
}

INLINE int is_within(const Surfaces *s, double u, double v) {
  double low, high;
  u_range(s, v, &low, &high);
  return v >= s->v_low && v <= s->v_high && u >= low && u <= high;
}

/* A spot in the rim's coordinates (w, v): depth, slopes, minus the second derivatives ww, wv, vv; tangents. */
typedef struct {
  double x[2], stretch, slope[2], curvature[3], tangent[2][3];
} Charted;

INLINE Charted charted(const Surfaces *s, const Spot *spot) {
  Charted c;
  const double *k = spot->curvature, b_u = spot->slope[0];
  double stretch[3], lean, k_uv;
  stretch_of(s, spot->v, stretch);
  c.x[0] = spot->u / stretch[0], c.x[1] = spot->v, c.stretch = stretch[0];
  lean = c.x[0] * stretch[1];
  k_uv = k[1] + lean * k[0];
  c.slope[0] = stretch[0] * b_u, c.slope[1] = spot->slope[1] + lean * b_u;
  c.curvature[0] = stretch[0] * stretch[0] * k[0];
  c.curvature[1] = stretch[0] * k_uv - stretch[1] * b_u;
  c.curvature[2] = k[2] + lean * (k[1] + k_uv) - c.x[0] * stretch[2] * b_u;
  for (int i = 0; i < 3; i++) {
    c.tangent[0][i] = stretch[0] * spot->tangent[0][i];
    c.tangent[1][i] = spot->tangent[1][i] + lean * spot->tangent[0][i];
  }
  return c;
}

/* The point of the patch where the depth (AT_START: -g) has the maximum that is uphill from a spot. */
INLINE Spot highest(const Surfaces *s, const Place *p, Spot spot, int what) {
  double low[2], high[2], trust = 1.0;
  box_of(s, low, high);
  for (int i = 0; i < SEARCH_STEPS; i++) {
    const Charted at = charted(s, &spot);
    const double k[2] = {larger(at.curvature[0], LEAST_CURVATURE * at.stretch * at.stretch),
                         larger(at.curvature[2], LEAST_CURVATURE)};
    double step[2] = {0.0, 0.0}, part = 0.0, stretch[3];
    Spot tried;
    for (int j = 0; j < 2 * SWEEPS; j++) {
      const int e = j % 2;
      const double reach = trust * (high[e] - low[e]);
      step[e] = bounded_by((at.slope[e] - at.curvature[1] * step[1 - e]) / k[e], larger(low[e] - at.x[e], -reach),
                           smaller(high[e] - at.x[e], reach));
    }
    for (int e = 0; e < 2; e++) part = larger(part, fabs(step[e]) / (high[e] - low[e]));
    stretch_of(s, at.x[1] + step[1], stretch);
    tried = spot_at(s, p, (at.x[0] + step[0]) * stretch[0], at.x[1] + step[1], what);
    if (part < LEAST_STEP) return tried;
    if (tried.depth > spot.depth) {
      spot = tried;
      trust *= 2.0;
    } else {
      trust = 0.25 * part;
    }
  }
  return spot;
}

/* The point nearest to the body, from the lowest of a point and the starts; of a flat body, from each row of starts. */
FUNCTION Spot nearest_to(const Surfaces *s, const Place *p, double u, double v) {
  Spot best = spot_at(s, p, u, v, AT_START);
  double low[2], high[2], least[STARTS], along[STARTS], across[STARTS], gauss;
  int lowest = 0;
  box_of(s, low, high);
  for (int row = 0; row < STARTS; row++) {
    double stretch[3];
    across[row] = low[1] + (high[1] - low[1]) * starts[row], least[row] = 1e300, along[row] = u;
    stretch_of(s, across[row], stretch);
    for (int i = 0; i < STARTS; i += BLOCK) {
      const Lanes places = (low[0] + (high[0] - low[0]) * lanes_at(starts + i)) * stretch[0];
      Ray ray;
      cast(s, p, places, all(across[row]), OWN_ARC, AT_START, &ray);
      for (int l = 0; l < BLOCK && i + l < STARTS; l++) {
        if (ray.g[l] < least[row]) least[row] = ray.g[l], along[row] = places[l];
      }
    }
    if (least[row] < least[lowest]) lowest = row;
  }
  if (least[lowest] < -best.depth) best = spot_at(s, p, along[lowest], across[lowest], AT_START);
  best = highest(s, p, best, AT_START);
  gauss = best.curvature[0] * best.curvature[2] - best.curvature[1] * best.curvature[1];
  if (best.curvature[0] > 0.0 && gauss > LEAST_CONVEXITY * best.kappa / (s->tube_radius - best.depth)) return best;
  for (int row = 0; row < STARTS; row++) {
    const Spot other = highest(s, p, spot_at(s, p, along[row], across[row], AT_START), AT_START);
    if (other.depth > best.depth) best = other;
  }
  return best;
}

/* The deepest point along the rays: at the rim it is not the nearest one, from which the search for it runs. */
FUNCTION Spot deepest_within(const Surfaces *s, const Place *p, double u, double v) {
  const Spot near = nearest_to(s, p, u, v);
  return highest(s, p, spot_at(s, p, near.u, near.v, TO_END), TO_END);
}

/* The middle of a spot: the formulas of contact/polar/peak.py. */

INLINE void turn_to_body(const Place *p, const double x[3], double out[2]) {
  for (int i = 0; i < 2; i++) out[i] = p->r[0][i] * x[0] + p->r[1][i] * x[1] + p->r[2][i] * x[2];
}

INLINE void turn_to_chart(const Place *p, double x, double y, double z, double out[3]) {
  for (int i = 0; i < 3; i++) out[i] = p->r[i][0] * x + p->r[i][1] * y + p->r[i][2] * z;
}

/* The arc on which the body reaches farthest along a direction of its own frame. */
INLINE int arc_along(const Surfaces *s, double x, double y) {
  int arc = 0;
  while (arc < ARCS - 1 && x * s->arc[arc].tangent_x + y * s->arc[arc].tangent_y > 0.0) arc++;
  return arc;
}

/* Where the surfaces face each other with parallel normals, within the rim or not. */
INLINE void deepest(const Surfaces *s, const Place *p, double *u, double *v) {
  double direction[3] = {0.0, -1.0, 0.0}, centre[3], seen[2];
#if TORUS
  int arc = ARCS > 1 ? 1 : 0;
  double rho = 1.0, out = 1.0, z = 0.0, distance = 1.0;
  for (int i = 0; i < ARCS; i++) {
    const int before = arc;
    double x, y, inverse;
    turn_to_chart(p, s->arc[arc].axis_x, s->arc[arc].axis_y, s->centre_z, centre);
    x = centre[0] + p->t[0], y = centre[1] + p->t[1] - s->height;
    inverse = -s->w_sign / larger(sqrt(x * x + y * y), LEAST_LENGTH);
    direction[0] = x * inverse, direction[1] = y * inverse;
    turn_to_body(p, direction, seen);
    arc = arc_along(s, seen[0], seen[1]);
    if (arc == before) break;
  }
#endif
  for (int i = 0; i < (TORUS ? CENTRE_STEPS : 1); i++) {
    const Arc *arc;
    double inverse;
    turn_to_body(p, direction, seen);
    inverse = 1.0 / larger(sqrt(seen[0] * seen[0] + seen[1] * seen[1]), LEAST_LENGTH);
    arc = s->arc + arc_along(s, seen[0], seen[1]);
    turn_to_chart(p, arc->axis_x + arc->offset * seen[0] * inverse, arc->axis_y + arc->offset * seen[1] * inverse,
                  s->centre_z, centre);
    for (int k = 0; k < 3; k++) centre[k] += p->t[k];
#if TORUS
    centre[1] -= s->height;
    rho = larger(sqrt(centre[0] * centre[0] + centre[1] * centre[1]), LEAST_LENGTH);
    out = rho - s->offset, z = centre[2] - s->z_0;
    distance = larger(sqrt(out * out + z * z), LEAST_LENGTH);
    inverse = out / (distance * rho);
    direction[0] = centre[0] * inverse, direction[1] = centre[1] * inverse, direction[2] = z / distance;
#endif
  }
#if TORUS
  *u = (s->offset + s->radius * out / distance) * centre[0] / rho;
  *v = s->radius * z / distance;
#else
  *u = centre[0], *v = centre[2] - s->z_0;
#endif
}

/* Where the chord along u (0) or v (1) through a spot ends, (u, v) each: estimates, within the rim */
INLINE void chord_ends(const Surfaces *s, const Spot *spot, int along, double ends[2][2]) {
  for (int i = 0; i < 2; i++) {
    const double sign = i ? 1.0 : -1.0;
    const double depth = larger(spot->depth, 0.0), slope = sign * spot->slope[along];
    ends[i][0] = spot->u, ends[i][1] = spot->v;
    ends[i][along] += sign * edge_of(all(depth), all(slope), all(spot->curvature[2 * along]))[0];
    within(s, ends[i], ends[i] + 1);
  }
}

/* The middle of the chord, or the spot where its estimated ends missed the contact. */
FUNCTION Spot chord_middle(const Surfaces *s, const Place *p, const Spot *spot, int along) {
  double ends[2][2], u, v;
  Spot tried;
  chord_ends(s, spot, along, ends);
  u = 0.5 * (ends[0][0] + ends[1][0]), v = 0.5 * (ends[0][1] + ends[1][1]);
  within(s, &u, &v);
  tried = spot_at(s, p, u, v, TO_END);
  return tried.depth >= 0.5 * spot->depth ? tried : *spot;
}

/* The spot at the middle; form: of determinant 1, maps a circle to a curve like the edge of contact. */
typedef struct {
  Spot spot;
  double form[2][2];
  int whole; /* the rim does not cut it */
} Middle;

/* K^(-1/2) = (adj K + s 1)/sqrt(s (tr K + 2 s)), s = sqrt(det K), scaled to a determinant of 1 */
INLINE void as_ellipse(Middle *middle) {
  const double *k = middle->spot.curvature, s = sqrt(k[0] * k[2] - k[1] * k[1]);
  const double size = sqrt(s * (k[0] + k[2] + 2.0 * s));
  middle->form[0][0] = (k[2] + s) / size, middle->form[1][1] = (k[0] + s) / size;
  middle->form[0][1] = middle->form[1][0] = -k[1] / size;
}

/* As long and wide as the chords through the spot */
INLINE void as_long(const Surfaces *s, Middle *middle) {
  double ends[2][2], length[2], ratio;
  for (int along = 0; along < 2; along++) {
    chord_ends(s, &middle->spot, along, ends);
    length[along] = larger(ends[1][along] - ends[0][along], LEAST_CHORD);
  }
  ratio = sqrt(length[0] / length[1]);
  middle->form[0][0] = ratio, middle->form[1][1] = 1.0 / ratio;
  middle->form[0][1] = middle->form[1][0] = 0.0;
}

/* The middle of a spot that the rim may cut, from its point nearest to the body */
INLINE void place_at_rim(const Surfaces *s, const Place *p, const Spot *nearest, Middle *middle) {
  middle->spot = spot_at(s, p, nearest->u, nearest->v, TO_END);
  for (int along = 0; along < 2; along++) middle->spot = chord_middle(s, p, &middle->spot, along);
  as_long(s, middle);
  middle->whole = 0;
}

/* The middle of the spot: the deepest point, and where the rim cuts the spot the middle of chords through the point
 * nearest to the body. Returns 0 where there is no contact, which leaves this point in `nearest`. */
FUNCTION int middle_of(const Surfaces *s, const Place *p, Middle *middle, Spot *nearest) {
  Spot *spot = &middle->spot;
  const double *k = spot->curvature, *slope = spot->slope;
  double u, v, determinant, reach_u, reach_v, depth;
  int whole;
  deepest(s, p, &u, &v);
  whole = is_within(s, u, v);
  within(s, &u, &v);
  *spot = spot_at(s, p, u, v, TO_END);
  depth = larger(spot->depth, 0.0);
  determinant = larger(k[0] * k[2] - k[1] * k[1], LEAST_CURVATURE * LEAST_CURVATURE);
  whole = whole && k[0] > 0.0 && determinant > LEAST_CURVATURE * LEAST_CURVATURE;
  reach_u = whole ? sqrt(2.0 * depth * k[2] / determinant) : 0.0;
  reach_v = whole ? sqrt(2.0 * depth * k[0] / determinant) : 0.0;
  middle->whole = whole && is_within(s, u - reach_u, v) && is_within(s, u + reach_u, v) &&
                  is_within(s, u, v - reach_v) && is_within(s, u, v + reach_v) &&
                  k[2] * slope[0] * slope[0] - 2.0 * k[1] * slope[0] * slope[1] + k[0] * slope[1] * slope[1] <
                      MOST_RISE * depth * determinant;
  if (middle->whole) {
    as_ellipse(middle);
    return 1;
  }
  *nearest = nearest_to(s, p, u, v);
  if (!(nearest->depth > 0.0)) return 0;
  place_at_rim(s, p, nearest, middle);
  return 1;
}
