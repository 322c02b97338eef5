/* Polar quadrature of a patch: the formulas of contact/polar/quadrature.py. */

FUNCTION void lines_of(const Surfaces *s, const Place *p, const Middle *middle, Lines *lines) {
  lines->count = 0;
  add_rays(middle, lines);
#if TORUS
  if (s->close_fit > 0.0) {
    Middle second;
    if (second_middle(s, p, middle, &second)) add_rays(&second, lines);
  }
#endif
#if ARCS > 1
  if (middle->whole) {
    Chord chord[ARCS - 1];
    for (int i = 0; i < ARCS - 1; i++) place_chord(s, p, &middle->spot, i, chord + i);
    for (int i = 0; i < ARCS - 1; i++) {
      measure_chord(s, p, &middle->spot, chord, i, chord + i);
      if (chord[i].half > 0.0) add_cap(s, p, middle, chord + i, lines);
    }
  }
#endif
  find_edges(s, p, lines);
}

/* V = (N, c x N) of a ray */
INLINE void load_of(const Ray *ray, Lanes u, Lanes z, Lanes load[6]) {
  load[0] = ray->n_x, load[1] = all(1.0), load[2] = ray->n_z;
  load[3] = ray->y * ray->n_z - z;
  load[4] = z * ray->n_x - u * ray->n_z;
  load[5] = u - ray->y * ray->n_x;
}

#if MOVING
/* What of a ray's load depends on the motion */
INLINE void slip_of(const Place *p, const Ray *ray, const Lanes c[3], Slip *slip) {
  const Lanes inverse = 1.0 / ray->length, n[3] = {ray->n_x * inverse, inverse, ray->n_z * inverse};
  slip_at(p->motion, c, n, ray->length, slip);
}
#endif

/* Derivatives of the depth at a ray's end by the twist: -(G, arm x G)/sigma */
INLINE void depth_slope(const Place *p, const Ray *ray, Lanes arm[3], Lanes slope[6]) {
  const Lanes sigma = ray->length / steepness(ray);
  for (int k = 0; k < 3; k++) arm[k] = ray->x[k] - p->t[k];
  twist_of(ray->gradient, arm, slope);
  for (int k = 0; k < 6; k++) slope[k] *= -sigma;
}

/* -sum weight p V; with order FIRST also its slopes, -sum weight p' V d_a, and those by the motion */
INLINE void polar_wrench(const Surfaces *s, const Place *p, const Points *points, int order, PatchLoads *out) {
  Lanes load[6][ENDS], slope[6][ENDS], sum[6] = {{0.0}};
#if MOVING
  Lanes by_motion[6][LOCALS] = {{{0.0}}};
#endif
  for (int i = 0; i < points->count; i++) {
    const Lanes u = points->at[i].u, v = points->at[i].v, weight = points->at[i].weight;
    Lanes here[6], d[6], arm[3], depth, force, scale;
    Ray ray;
    cast(s, p, u, v, points->at[i].arc, order == FIRST ? TO_END : DEPTH_ONLY, &ray);
    depth = ray.step * ray.length;
    force = weight * pressure_at(depth);
    load_of(&ray, u, v + s->z_0, here);
#if MOVING
    {
      const Lanes c[3] = {u, ray.y, v + s->z_0};
      Slip slip;
      slip_of(p, &ray, c, &slip);
      if (order == FIRST) add_rub_slopes(&slip, p->motion, c, here, -force, by_motion);
      rub(&slip, here);
    }
#endif
    for (int k = 0; k < 6; k++) sum[k] -= force * here[k];
    if (order != FIRST) continue;
    scale = -weight * pressure_slope_at(depth);
    depth_slope(p, &ray, arm, d);
    for (int k = 0; k < 6; k++) load[k][i] = here[k], slope[k][i] = scale * d[k];
  }
  KEEP_LOOP for (int k = 0; k < 6; k++) {
    out->wrench[k] = sum_of(sum[k]);
    if (order != FIRST) continue;
    KEEP_LOOP for (int a = 0; a < 6; a++) out->stiffness[k][a] = sum_of(product_sum(points->count, load[k], slope[a]));
#if MOVING
    for (int b = 0; b < LOCALS; b++) out->by_motion[k][b] = sum_of(by_motion[k][b]);
#endif
  }
}

/* Second derivatives by twist, a first and b last, of the weighted sum of the wrench's components. From g = 0 at a
 * ray's end, differentiated twice, with b_a = -n d_a - (velocity of the body there) and m = (0, n x G):
 *   sigma d_ab = b_a (Hessian of g) b_b + m_a d_b + d_a m_b + turning,   -sum weight (p' d_ab + p'' d_a d_b);
 * the Hessian of g has the curvatures 1/tube_radius and kappa. At the edges p' jumps to zero, which adds
 * -width p'(0) d_a d_b / |d_r|. All are sums of products left_a right_b. */
#define PRODUCTS (4 * ENDS + LINE_BLOCKS)

INLINE void polar_curvature(const Surfaces *s, const Place *p, const Lines *lines, const Points *points,
                            const double weights[6], PatchLoads *out) {
  const double k_1 = 1.0 / s->tube_radius;
  const int n = points->count;
  double(*h)[6] = out->curvature;
#if MOVING
  Lanes moves[LOCALS][ENDS], drive[LOCALS] = {{0.0}}, local[LOCALS][LOCALS] = {{{0.0}}};
#endif
  Lanes left[6][PRODUCTS], right[6][PRODUCTS], forces[3] = {{0.0}}, turning[3][3] = {{{0.0}}};
  double force[3], arms[3][3];
  for (int i = 0; i < n + lines->count; i++) {
    const int edge = i - n; /* the points, then the edges */
    const Line *line = lines->line + (edge < 0 ? 0 : edge);
    const Lanes u = edge < 0 ? points->at[i].u : line->u + line->edge * line->du;
    const Lanes v = edge < 0 ? points->at[i].v : line->v + line->edge * line->dv;
    Lanes load[6], d[6], arm[3], depth, pull = all(0.0), sigma, inverse;
    Ray ray;
    cast(s, p, u, v, edge < 0 ? points->at[i].arc : line->arc, TO_END, &ray);
    depth = ray.step * ray.length;
    inverse = 1.0 / ray.length;
    sigma = ray.length / steepness(&ray);
    load_of(&ray, u, v + s->z_0, load);
    for (int k = 0; k < 6; k++) pull += weights[k] * load[k];
    depth_slope(p, &ray, arm, d);
#if MOVING
    {
      const Lanes c[3] = {u, ray.y, v + s->z_0}, weight = edge < 0 ? -points->at[i].weight : all(0.0);
      const Lanes force = weight * pressure_at(depth), stiff = weight * pressure_slope_at(depth);
      Lanes by[LOCALS];
      Slip slip;
      Pull of;
      slip_of(p, &ray, c, &slip);
      pull = pull_of(&slip, p->motion, c, weights, pull, &of, by);
      for (int b = 0; b < LOCALS && edge < 0; b++) drive[b] += force * by[b], moves[b][i] = stiff * by[b];
      if (edge < 0) add_rub_curvature(&slip, p->motion, c, &of, force, local);
    }
#endif
    if (edge < 0) {
      const Lanes normal[3] = {ray.n_x * inverse, inverse, ray.n_z * inverse}, weight = -points->at[i].weight * pull;
      const Lanes mu = weight * pressure_slope_at(depth) * sigma, nu = 0.5 * weight * pressure_bend_at(depth);
      const Lanes over = dot_of(normal, ray.across), on = dot_of(normal, ray.along);
      Lanes across[6], along[6], turn[6];
      twist_of(ray.across, arm, across);
      twist_of(ray.along, arm, along);
      twist_of(ray.gradient, normal, turn);
      for (int k = 0; k < 6; k++) {
        const Lanes first = across[k] + over * d[k], second = along[k] + on * d[k];
        const Lanes third = k < 3 ? nu * d[k] : nu * d[k] + mu * turn[k];
        left[k][i] = k_1 * mu * first, right[k][i] = first;
        left[k][i + n] = ray.kappa * mu * second, right[k][i + n] = second;
        left[k][i + 2 * n] = third, right[k][i + 2 * n] = d[k];
        left[k][i + 3 * n] = d[k], right[k][i + 3 * n] = third;
      }
      for (int a = 0; a < 3; a++) {
        forces[a] += mu * ray.gradient[a];
        for (int b = 0; b < 3; b++) turning[a][b] += mu * ray.gradient[a] * arm[b];
      }
    } else {
      const Lanes steep = smaller_of(sigma * rise_of(&ray, line->du, line->dv), all(-LEAST_RISE));
      const Lanes jump = STIFFNESS_AT_ZERO * edge_width(line);
      for (int k = 0; k < 6; k++) left[k][4 * n + edge] = jump * pull / steep * d[k], right[k][4 * n + edge] = d[k];
    }
  }
  KEEP_LOOP for (int a = 0; a < 6; a++) {
    KEEP_LOOP for (int b = a; b < 6; b++) h[a][b] = h[b][a] = sum_of(product_sum(4 * n + lines->count, left[a], right[b]));
  }
  for (int a = 0; a < 3; a++) {
    force[a] = sum_of(forces[a]);
    for (int b = 0; b < 3; b++) arms[a][b] = sum_of(turning[a][b]);
  }
  add_turning(force, arms, h);
#if MOVING
  KEEP_LOOP for (int b = 0; b < LOCALS; b++) {
    out->gradient[b] = sum_of(drive[b]);
    KEEP_LOOP for (int a = 0; a < 6; a++) out->mixed[a][b] = sum_of(product_sum(n, right[a] + 2 * n, moves[b]));
    for (int c = b; c < LOCALS; c++) out->local[b][c] = out->local[c][b] = sum_of(local[b][c]);
  }
#endif
}

/* Second derivatives by twist of the gap at its nearest point, which slides along the patch as the body moves:
 * g_ab - g_ia (g_ij)^-1 g_jb over those of the coordinates w and v that the rim leaves free. */
INLINE void gap_curvature(const Surfaces *s, const Spot *nearest, const Ray *ray, const Lanes arm[3], double h[6][6]) {
  const double k_1 = 1.0 / (s->tube_radius + ray->g[0]), k_2 = ray->kappa[0], nudge = 1e-9;
  const Charted slide = charted(s, nearest);
  Lanes turned[6], twist_across[6], twist_along[6];
  double gradient[3], across[3], along[3], mixed[2][6], arms[3][3], k[2], k_wv, inverse;
  int free[2];
  twist_of(ray->across, arm, twist_across);
  twist_of(ray->along, arm, twist_along);
  for (int i = 0; i < 3; i++) {
    gradient[i] = ray->gradient[i][0], across[i] = ray->across[i][0], along[i] = ray->along[i][0];
    for (int j = 0; j < 3; j++) arms[i][j] = (ray->gradient[i] * arm[j])[0];
  }
  for (int a = 0; a < 6; a++) {
    for (int b = 0; b < 6; b++) {
      h[a][b] = (k_1 * twist_across[a] * twist_across[b] + k_2 * twist_along[a] * twist_along[b])[0];
    }
  }
  add_turning(gradient, arms, h);
  for (int i = 0; i < 2; i++) {
    const double *tau = slide.tangent[i];
    const Lanes tangent[3] = {all(tau[0]), all(tau[1]), all(tau[2])};
    const double over = k_1 * dot3(tau, across), on = k_2 * dot3(tau, along);
    twist_of(tangent, ray->gradient, turned);
    for (int b = 0; b < 6; b++) {
      mixed[i][b] = (b < 3 ? 0.0 : turned[b][0]) - over * twist_across[b][0] - on * twist_along[b][0];
    }
  }
  free[0] = is_within(s, nearest->u - nudge, nearest->v) && is_within(s, nearest->u + nudge, nearest->v);
  free[1] = nearest->v - nudge >= s->v_low && nearest->v + nudge <= s->v_high;
  for (int i = 0; i < 2; i++) {
    k[i] = free[i] ? slide.curvature[2 * i] : 1.0;
    for (int b = 0; b < 6; b++) mixed[i][b] *= free[i];
  }
  k_wv = slide.curvature[1] * free[0] * free[1];
  inverse = 1.0 / larger(k[0] * k[1] - k_wv * k_wv, LEAST_CURVATURE * LEAST_CURVATURE);
  for (int a = 0; a < 6; a++) {
    for (int b = 0; b < 6; b++) {
      h[a][b] -= inverse * (k[1] * mixed[0][a] * mixed[0][b] + k[0] * mixed[1][a] * mixed[1][b] -
                            k_wv * (mixed[0][a] * mixed[1][b] + mixed[1][a] * mixed[0][b]));
    }
  }
}

INLINE Place place_of(const Surfaces *s, const double *pose, const Frame *frame) {
  Place p;
#if MOVING
  turn_twist(s->turn, frame->motion, p.motion);
  memcpy(p.motion + 6, frame->motion + 6, sizeof(double[5]));
#endif
  for (int i = 0; i < 3; i++) {
    p.t[i] = dot3(s->turn[i], pose);
    for (int j = 0; j < 3; j++) {
      p.r[i][j] = s->turn[i][0] * frame->r[0][j] + s->turn[i][1] * frame->r[1][j] + s->turn[i][2] * frame->r[2][j];
    }
  }
  return p;
}

INLINE void loads_of_patch(int patch, const double *pose, const Frame *frame, int order, int with_gap,
                           const double *weights, PatchLoads *out) {
  const Surfaces *s = surfaces + patch;
  const Place place = place_of(s, pose, frame);
  Middle middle;
  Spot nearest;
  const int touching = middle_of(s, &place, &middle, &nearest);
  memset(out, 0, sizeof *out);
  if (touching && order == GAPS) nearest = nearest_to(s, &place, middle.spot.u, middle.spot.v);
  out->apart = !touching;
  if (with_gap && (!touching || order == GAPS)) {
    Lanes arm[3], push[6];
    Ray ray;
    cast(s, &place, all(nearest.u), all(nearest.v), OWN_ARC, AT_START, &ray);
    out->gap = ray.g[0];
    for (int k = 0; k < 3; k++) arm[k] = ray.x[k] - place.t[k];
    twist_of(ray.gradient, arm, push);
    for (int k = 0; k < 6; k++) out->gap_slope[k] = -push[k][0];
    if (order == SECOND) gap_curvature(s, &nearest, &ray, arm, out->gap_curvature);
  }
  if (touching && order != GAPS) {
    Lines lines;
    Points points;
    lines_of(s, &place, &middle, &lines);
    place_points(&lines, &points);
    out->cut = lines.cut;
    if (order != SECOND) polar_wrench(s, &place, &points, order, out);
    if (order == SECOND) {
      double turned_weights[6];
      turn_twist(s->turn, weights, turned_weights);
      polar_curvature(s, &place, &lines, &points, turned_weights, out);
    }
  }
  turn_back(s->turn, order, out);
}
