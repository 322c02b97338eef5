/* Pressure moments of a patch: the formulas of contact/polar/pressures.py. */

/* Derivatives of the depth at a ray's end by the twist: -(G, arm x G)/sigma */
INLINE void depth_slope(const Place *p, const Ray *ray, Lanes slope[6]) {
  const Lanes sigma = ray->length / steepness(ray);
  Lanes arm[3];
  for (int k = 0; k < 3; k++) arm[k] = ray->x[k] - p->t[k];
  twist_of(ray->gradient, arm, slope);
  for (int k = 0; k < 6; k++) slope[k] *= -sigma;
}

/* The area's derivative: - sum of turn/RAYS r |N| d_a / d_r over the edges that the rim does not make. */
INLINE void area_slope(const Surfaces *s, const Place *p, const Spot *m, const Plan *plan, double slope[6]) {
  Lanes sum[6] = {{0.0}};
  for (int j = 0; j < RAY_BLOCKS; j++) {
    Lanes d[6], steep, width;
    Ray ray;
    cast(s, p, m->u + plan->edge[j] * plan->du[j], m->v + plan->edge[j] * plan->dv[j], TO_END, &ray);
    depth_slope(p, &ray, d);
    steep = ray.length / steepness(&ray) * rise_of(&ray, plan->du[j], plan->dv[j]);
    width = FULL_TURN / RAYS * plan->edge[j] * ray.length * plan->inside[j] / smaller_of(steep, all(-LEAST_RISE));
    for (int k = 0; k < 6; k++) sum[k] -= width * d[k];
  }
  for (int k = 0; k < 6; k++) slope[k] = sum_of(sum[k]);
}

INLINE double largest_depth(const Surfaces *s, const Place *p, const Spot *middle, double slope[6]) {
  const Spot spot = deepest_within(s, p, middle->u, middle->v);
  Lanes d[6];
  Ray ray;
  cast(s, p, all(spot.u), all(spot.v), TO_END, &ray);
  depth_slope(p, &ray, d);
  for (int k = 0; k < 6; k++) slope[k] = d[k][0];
  return spot.depth;
}

FUNCTION void patch_moments(int patch, const double *pose, const Frame *frame, double value[6], double slope[6][6]) {
  const Surfaces *s = surfaces + patch;
  const Place p = place_of(s, pose, frame);
  Spot middle, nearest;
  Lanes sums[5] = {{0.0}}, rates[4][6] = {{{0.0}}};
  Plan plan;
  Points points;
  if (!middle_of(s, &p, &middle, &nearest)) return;
  plan_rays(s, &p, &middle, &plan);
  place_points(&middle, &plan, &points);
  for (int i = 0; i < points.count; i++) {
    Lanes d[6], depth, area, stiff;
    Ray ray;
    cast(s, &p, points.u[i], points.v[i], TO_END, &ray);
    depth = ray.step * ray.length, area = points.weight[i] * ray.length, stiff = area * pressure_slope_at(depth);
    {
      const Lanes weight[4] = {all(1.0), points.u[i], ray.y, points.v[i] + s->z_0}, force = area * pressure_at(depth);
      depth_slope(&p, &ray, d);
      sums[0] += area;
      for (int k = 0; k < 4; k++) {
        sums[1 + k] += force * weight[k];
        for (int a = 0; a < 6; a++) rates[k][a] += stiff * weight[k] * d[a];
      }
    }
  }
  for (int k = 0; k < 5; k++) value[k] = sum_of(sums[k]);
  for (int k = 0; k < 4; k++) {
    for (int a = 0; a < 6; a++) slope[1 + k][a] = sum_of(rates[k][a]);
  }
  area_slope(s, &p, &middle, &plan, slope[0]);
  value[5] = largest_depth(s, &p, &middle, slope[5]);
#if TURNED
  turn_back_vectors(s->turn, value + 2, slope + 2);
  for (int k = 0; k < 6; k++) turn_back_row(s->turn, slope[k]);
#endif
}
