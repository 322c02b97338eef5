/* Caps of a spot that other arcs press than the middle's: the formulas of contact/polar/lines.py. */

/* The line in the chart on which a junction lies; half its length within the contact, 0 where there is none. */
typedef struct {
  double u, v, along[2], across[2], half, plane[3], axis[3], rate, distance;
  int before, behind;
} Chord;

INLINE double form_of(const double k[3], const double a[2], const double b[2]) {
  return k[0] * a[0] * b[0] + k[1] * (a[0] * b[1] + a[1] * b[0]) + k[2] * a[1] * b[1];
}

INLINE double more_curved(const Surfaces *s, const Place *p, const Spot *m, int arc) {
  const Arc *own = s->arc + m->arc;
  const double from[3] = {m->end[0] - p->t[0], m->end[1] - p->t[1], m->end[2] - p->t[2]};
  double end[2], x, y, rho;
  turn_to_body(p, from, end);
  x = end[0] - own->axis_x, y = end[1] - own->axis_y;
  rho = sqrt(x * x + y * y);
  return m->kappa * (rho / larger(rho + s->arc[arc].offset - own->offset, LEAST_LENGTH) - 1.0);
}

/* The junction's plane, and the distance of the middle from it along the chart */
INLINE void place_chord(const Surfaces *s, const Place *p, const Spot *m, int junction, Chord *c) {
  const Arc *arc = s->arc + junction;
  const int forward = junction >= m->arc;
  const double away = forward ? 1.0 : -1.0;
  double rates[2], from[3];
  c->before = junction + !forward, c->behind = junction + forward;
  turn_to_chart(p, away * arc->tangent_x, away * arc->tangent_y, 0.0, c->plane);
  turn_to_chart(p, arc->axis_x, arc->axis_y, 0.0, c->axis);
  for (int i = 0; i < 3; i++) c->axis[i] += p->t[i], from[i] = m->end[i] - c->axis[i];
  for (int i = 0; i < 2; i++) rates[i] = dot3(m->tangent[i], c->plane);
  c->rate = larger(sqrt(rates[0] * rates[0] + rates[1] * rates[1]), LEAST_TILT);
  c->across[0] = rates[0] / c->rate, c->across[1] = rates[1] / c->rate;
  c->along[0] = -c->across[1], c->along[1] = c->across[0];
  c->distance = -dot3(from, c->plane) / c->rate;
}

/* Its place of the largest depth and its length, from the depth at the middle and the curvatures of the arcs between */
INLINE void measure_chord(const Surfaces *s, const Place *p, const Spot *m, const Chord *chords, int junction,
                          Chord *c) {
  const double *k = m->curvature, distance = c->distance;
  const double bend = c->across[0] * dot3(m->tangent[0], m->along) + c->across[1] * dot3(m->tangent[1], m->along);
  const int step = junction >= m->arc ? 1 : -1;
  double slope[2], k_across, k_along, top, depth, more = 0.0;
  for (int i = step > 0 ? m->arc : m->arc - 1; i != junction; i += step) {
    const double way = larger(distance - chords[i].distance, 0.0);
    more += (more_curved(s, p, m, chords[i].behind) - more_curved(s, p, m, chords[i].before)) * way * way;
  }
  k_across = form_of(k, c->across, c->across), k_along = larger(form_of(k, c->along, c->along), LEAST_CURVATURE);
  slope[0] = m->slope[0] * c->across[0] + m->slope[1] * c->across[1];
  slope[1] = m->slope[0] * c->along[0] + m->slope[1] * c->along[1] - form_of(k, c->across, c->along) * distance;
  top = slope[1] / k_along;
  depth = larger(m->depth, 0.0) + (slope[0] - 0.5 * k_across * distance) * distance + 0.5 * slope[1] * top;
  depth -= 0.5 * bend * bend * more;
  c->u = m->u + distance * c->across[0] + top * c->along[0];
  c->v = m->v + distance * c->across[1] + top * c->along[1];
  c->half = sqrt(2.0 * larger(depth, 0.0) / k_along);
}

/* The chord's ends, by Newton's method of g = 0 and on the junction's plane */
INLINE void chord_ends_of(const Surfaces *s, const Place *p, const Chord *c, double ends[2][2]) {
  const Lanes most = all(0.5 * c->half), least = all(-0.5 * c->half);
  Lanes outwards = all(-1.0), at, r = all(0.0);
  for (int l = 1; l < BLOCK; l += 2) outwards[l] = 1.0;
  at = c->half * outwards;
  for (int i = 0; i < CHORD_STEPS; i++) {
    Lanes step = all(0.0), out;
    Ray ray;
    cast(s, p, c->u + at * c->along[0] + r * c->across[0], c->v + at * c->along[1] + r * c->across[1], c->before, TO_END,
         &ray);
    for (int k = 0; k < 3; k++) step -= (ray.x[k] - c->axis[k]) * c->plane[k];
    step = smaller_of(larger_of(step / c->rate, least), most);
    out = (ray.g + rise_of(&ray, all(c->across[0]), all(c->across[1])) * step) /
          larger_of(outwards * rise_of(&ray, all(c->along[0]), all(c->along[1])), all(LEAST_RISE));
    at -= outwards * smaller_of(larger_of(out, least), most);
    r += step;
  }
  for (int i = 0; i < 2; i++) {
    ends[i][0] = c->u + at[i] * c->along[0] + r[i] * c->across[0];
    ends[i][1] = c->v + at[i] * c->along[1] + r[i] * c->across[1];
  }
}

/* A fan of rays over the chord, a right angle in a circle of `form`: start, half the chord, direction across it. */
typedef struct {
  double u, v, half[2], across[2], size;
} Fan;

INLINE Fan fan_of(const Middle *middle, const double ends[2][2]) {
  const double(*form)[2] = middle->form;
  const double determinant = form[0][0] * form[1][1] - form[0][1] * form[1][0];
  double x[2][2], start[2];
  Fan fan;
  for (int i = 0; i < 2; i++) {
    x[i][0] = (form[1][1] * ends[i][0] - form[0][1] * ends[i][1]) / determinant;
    x[i][1] = (form[0][0] * ends[i][1] - form[1][0] * ends[i][0]) / determinant;
  }
  for (int i = 0; i < 2; i++) fan.half[i] = 0.5 * (x[1][i] - x[0][i]);
  fan.across[0] = fan.half[1], fan.across[1] = -fan.half[0];
  for (int i = 0; i < 2; i++) start[i] = 0.5 * (x[0][i] + x[1][i]) - fan.across[i];
  fan.u = form[0][0] * start[0] + form[0][1] * start[1], fan.v = form[1][0] * start[0] + form[1][1] * start[1];
  fan.size = larger(sqrt(fan.half[0] * fan.half[0] + fan.half[1] * fan.half[1]), LEAST_CHORD);
  for (int i = 0; i < 2; i++) fan.half[i] /= fan.size, fan.across[i] /= fan.size;
  return fan;
}

FUNCTION void add_cap(const Surfaces *s, const Place *p, const Middle *middle, const Chord *c, Lines *lines) {
  const Spot *m = &middle->spot;
  const double more[2] = {more_curved(s, p, m, c->before), more_curved(s, p, m, c->behind)};
  const double bends[2] = {dot3(m->tangent[0], m->along), dot3(m->tangent[1], m->along)};
  double ends[2][2];
  Fan fan;
  chord_ends_of(s, p, c, ends);
  fan = fan_of(middle, ends);
  if (fan.size <= LEAST_CHORD) return;
  for (int j = 0; j < CAP_BLOCKS; j++) {
    const Lanes cosine = lanes_at(fan_cos + j * BLOCK), sine = lanes_at(fan_sin + j * BLOCK);
    const Lanes x = cosine * fan.across[0] + sine * fan.half[0], y = cosine * fan.across[1] + sine * fan.half[1];
    const Lanes du = middle->form[0][0] * x + middle->form[0][1] * y, dv = middle->form[1][0] * x + middle->form[1][1] * y;
    const Lanes k = m->curvature[0] * du * du + 2.0 * m->curvature[1] * du * dv + m->curvature[2] * dv * dv;
    const Lanes bend = du * bends[0] + dv * bends[1];
    const Lanes turned = du * c->across[0] + dv * c->across[1];
    const Mask sound = turned > 0.0; /* else the chord is too short to have a direction */
    const Lanes rate = c->rate * pick(sound, turned, all(1.0));
    Lanes r = fan.size / cosine, left, falls, weight;
    Ray ray;
    for (int i = 0; i < CHORD_STEPS; i++) {
      Lanes past = all(0.0);
      cast(s, p, fan.u + r * du, fan.v + r * dv, c->before, TO_END, &ray);
      for (int k = 0; k < 3; k++) past += (ray.x[k] - c->axis[k]) * c->plane[k];
      r -= pick(sound, past / rate, all(0.0));
    }
    left = larger_of(-ray.g, all(0.0)), falls = -rise_of(&ray, du, dv);
    weight = pick(sound & (ray.g < 0.0), lanes_at(fan_weight + j * BLOCK), all(0.0)); /* none where there is no chord */
    for (int behind = 0; behind < 2; behind++) {
      const double sign = behind ? 1.0 : -1.0;
      Line *line = lines->line + lines->count++;
      line->u = fan.u + r * du, line->v = fan.v + r * dv, line->du = du, line->dv = dv;
      line->edge = pick(weight > 0.0, edge_of(left, falls, k + more[behind] * bend * bend), all(0.0));
      line->spread = sign * weight, line->width = line->spread * r;
      line->arc = behind ? c->behind : c->before;
    }
  }
}
