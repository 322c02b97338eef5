/* Pressure outputs of a pose, seven for each patch in the order of contact/pressures.py: area [mm2], mean and peak
 * pressure [MPa], centre of pressure [mm] (NaN out of contact), penetration [mm]. From patch_moments, see pressures.h. */
FUNCTION void pressures_at(const double *pose, double *pressures) {
  const Frame frame = frame_of(pose);
  for (int p = 0; p < PATCHES; p++) {
    double *of = pressures + 7 * p, m[6] = {0.0}, by_twist[6][6];
    patch_moments(p, pose, &frame, m, by_twist);
    of[0] = m[0];
    of[1] = m[1] > 0.0 ? m[1] / m[0] : 0.0;
    of[2] = pressure_at(all(m[5]))[0];
    for (int k = 0; k < 3; k++) of[3 + k] = m[1] > 0.0 ? m[2 + k] / m[1] : NAN;
    of[6] = m[5];
  }
}
