/* Pressure moments of a patch: the formulas of contact/polar/quadrature.py. */

/* The area's derivative: - sum of width |N| d_a / d_r over the edges that the rim does not make. */
INLINE void area_slope(const Surfaces *s, const Place *p, const Lines *lines, double slope[6]) {
  Lanes sum[6] = {{0.0}};
  for (int j = 0; j < lines->count; j++) {
    const Line *line = lines->line + j;
    Lanes arm[3], d[6], steep, width;
    Ray ray;
    cast(s, p, line->u + line->edge * line->du, line->v + line->edge * line->dv, line->arc, TO_END, &ray);
    depth_slope(p, &ray, arm, d);
    steep = ray.length / steepness(&ray) * rise_of(&ray, line->du, line->dv);
    width = edge_width(line) * ray.length / smaller_of(steep, all(-LEAST_RISE));
    for (int k = 0; k < 6; k++) sum[k] -= width * d[k];
  }
  for (int k = 0; k < 6; k++) slope[k] = sum_of(sum[k]);
}

INLINE double largest_depth(const Surfaces *s, const Place *p, const Spot *middle, double slope[6]) {
  const Spot spot = deepest_within(s, p, middle->u, middle->v);
  Lanes arm[3], d[6];
  Ray ray;
  cast(s, p, all(spot.u), all(spot.v), OWN_ARC, TO_END, &ray);
  depth_slope(p, &ray, arm, d);
  for (int k = 0; k < 6; k++) slope[k] = d[k][0];
  return spot.depth;
}

FUNCTION void patch_moments(int patch, const double *pose, const Frame *frame, double value[6], double slope[6][6]) {
  const Surfaces *s = surfaces + patch;
  const Place p = place_of(s, pose, frame);
  Middle middle;
  Spot nearest;
  Lanes sums[5] = {{0.0}}, rates[4][6] = {{{0.0}}};
  Lines lines;
  Points points;
  if (!middle_of(s, &p, &middle, &nearest)) return;
  lines_of(s, &p, &middle, &lines);
  place_points(&lines, &points);
  for (int i = 0; i < points.count; i++) {
    const Lanes u = points.at[i].u, v = points.at[i].v;
    Lanes arm[3], d[6], depth, area, stiff, force;
    Ray ray;
    cast(s, &p, u, v, points.at[i].arc, TO_END, &ray);
    depth = ray.step * ray.length, area = points.at[i].weight * ray.length, stiff = area * pressure_slope_at(depth);
    force = area * pressure_at(depth);
    depth_slope(&p, &ray, arm, d);
    sums[0] += area;
    for (int k = 0; k < 4; k++) {
      const Lanes weight = k == 0 ? all(1.0) : (k == 1 ? u : (k == 2 ? ray.y : v + s->z_0));
      sums[1 + k] += force * weight;
      for (int a = 0; a < 6; a++) rates[k][a] += stiff * weight * d[a];
    }
  }
  for (int k = 0; k < 5; k++) value[k] = sum_of(sums[k]);
  for (int k = 0; k < 4; k++) for (int a = 0; a < 6; a++) slope[1 + k][a] = sum_of(rates[k][a]);
  area_slope(s, &p, &lines, slope[0]);
  value[5] = largest_depth(s, &p, &middle.spot, slope[5]);
#if TURNED
  turn_back_vector(s->turn, value + 2, 1);
  for (int a = 0; a < 6; a++) turn_back_vector(s->turn, slope[2] + a, 6);
  for (int k = 0; k < 6; k++) turn_back_row(s->turn, slope[k]);
#endif
}
