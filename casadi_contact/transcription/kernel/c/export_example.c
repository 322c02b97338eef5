/* Reads poses (six numbers each: $pose) from standard input, or takes a built-in one with the argument "demo".
 * Prints the loads of each pose, its Jacobian (one row per load), and the Hessian of the sum of all loads. */
#include <stdio.h>
#include <string.h>

#include "$name.h"

static void print_row(const double *values, int count) {
  for (int i = 0; i < count; i++) printf("%.17g%c", values[i], i + 1 < count ? ' ' : '\n');
}

static void evaluate(const double pose[6]) {
  double loads[${guard}_LOADS], jacobian[${guard}_LOADS][6], weights[${guard}_LOADS], hessian[6][6];
  for (int i = 0; i < ${guard}_LOADS; i++) weights[i] = 1.0;
  ${name}_jacobian(pose, loads, jacobian);
  ${name}_hessian(pose, weights, hessian);
  print_row(loads, ${guard}_LOADS);
  for (int i = 0; i < ${guard}_LOADS; i++) print_row(jacobian[i], 6);
  for (int i = 0; i < 6; i++) print_row(hessian[i], 6);
}

int main(int argc, char **argv) {
  double pose[6] = {$example_pose};
  if (argc > 1 && strcmp(argv[1], "demo") == 0) {
    double loads[${guard}_LOADS];
    ${name}_loads(pose, loads);
    for (int i = 0; i < ${guard}_LOADS; i++) printf("%-8s %14.6f\n", ${name}_load_names[i], loads[i]);
    return 0;
  }
  while (scanf("%lf %lf %lf %lf %lf %lf", pose, pose + 1, pose + 2, pose + 3, pose + 4, pose + 5) == 6) evaluate(pose);
  return 0;
}
