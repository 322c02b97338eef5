/* A second spot of contact, where one of the two lies on the rim: the formulas of contact/polar/quadrature.py. */

INLINE int on_rim(const double low[2], const double high[2], const Charted *at) {
  int found = 0;
  for (int e = 0; e < 2; e++) {
    found |= smaller(at->x[e] - low[e], high[e] - at->x[e]) <= RIM_TOLERANCE * (high[e] - low[e]);
  }
  return found;
}

/* Follows g from a start down to the spot; returns 0 where there is none. */
FUNCTION int second_from(const Surfaces *s, const Place *p, const Middle *first, double u, double v, Middle *second) {
  const Spot near = highest(s, p, spot_at(s, p, u, v, AT_START), AT_START);
  const Charted at = charted(s, &near);
  double low[2], high[2];
  Ray ray;
  box_of(s, low, high);
  if (!(near.depth > 0.0) || (first->whole && !on_rim(low, high, &at))) return 0;
  cast(s, p, all(near.u), all(near.v), OWN_ARC, AT_START, &ray);
  if (!((steepness(&ray) / ray.length)[0] < FACING)) return 0;
  cast(s, p, all(0.5 * (near.u + first->spot.u)), all(0.5 * (near.v + first->spot.v)), OWN_ARC, AT_START, &ray);
  if (!first->whole && !(ray.g[0] > 0.0)) return 0;
  place_at_rim(s, p, &near, second);
  return 1;
}

/* Returns 0 where there is none. */
FUNCTION int second_middle(const Surfaces *s, const Place *p, const Middle *first, Middle *second) {
  double low[2], high[2], least = RIM_REACH, u = 0.0, v = 0.0;
  box_of(s, low, high);
  for (int i = 0; i < RIM_STARTS; i += BLOCK) {
    const Lanes out_u = lanes_at(rim_out_u + i), out_v = lanes_at(rim_out_v + i);
    const Lanes across = low[1] + (high[1] - low[1]) * lanes_at(rim_v + i);
    const Lanes w = low[0] + (high[0] - low[0]) * lanes_at(rim_w + i);
    Lanes along = w, g;
    Mask found;
    Ray ray;
#if CURVED_RIM
    along *= s->offset + s->rho_sign * root(s->radius * s->radius - across * across);
#endif
    cast(s, p, along, across, OWN_ARC, AT_START, &ray);
    if (!any(ray.g < RIM_REACH)) continue;
    found = smaller_of(rise_of(&ray, out_u, all(0.0)), rise_of(&ray, all(0.0), out_v)) < 0.0;
    if (!first->whole) {
      const Charted here = charted(s, &first->spot);
      found &= (size_of(w - here.x[0]) > 0.5 * (high[0] - low[0])) | (size_of(across - here.x[1]) > 0.5 * (high[1] - low[1]));
    }
    g = pick(found, ray.g, all(RIM_REACH));
    if (!any(g < least)) continue;
    for (int l = 0; l < BLOCK; l++) {
      if (g[l] < least) least = g[l], u = along[l], v = across[l];
    }
  }
  return least < RIM_REACH && second_from(s, p, first, u, v, second);
}
