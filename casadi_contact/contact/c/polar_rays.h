/* Rays from the middle of a spot: the formulas of contact/polar/rays.py. */
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
