/* Reads poses (six numbers each: $pose) from standard input, or takes a built-in one with the argument "demo".
 * Prints the loads of each pose, its Jacobian (one row per load), and the Hessian of the sum of all loads. Says on
 * standard error, and by the exit status 1, where a pose is not one that the model is made for; by 2 where six numbers do not follow. */
#include <stdio.h>
#include <string.h>

#include "$name.h"

static int told(const double pose[6]) {
  const int status = ${name}_status(pose);
  if (status == ${guard}_OUTSIDE) fprintf(stderr, "pose out of the model's range ($learned): its loads mean nothing\n");
  if (status == ${guard}_NOT_FINITE) fprintf(stderr, "pose is not finite\n");
  return status != ${guard}_OK;
}

static void print_row(const double *values, int count) {
  for (int i = 0; i < count; i++) printf("%.17g%c", values[i], i + 1 < count ? ' ' : '\n');
}

static int evaluate(const double pose[6]) {
  double loads[${guard}_LOADS], jacobian[${guard}_LOADS][6], weights[${guard}_LOADS], hessian[6][6];
  ${name}_jacobian(pose, loads, jacobian);
  for (int i = 0; i < ${guard}_LOADS; i++) weights[i] = 1.0;
  ${name}_hessian(pose, weights, hessian);
  print_row(loads, ${guard}_LOADS);
  for (int i = 0; i < ${guard}_LOADS; i++) print_row(jacobian[i], 6);
  for (int i = 0; i < 6; i++) print_row(hessian[i], 6);
  return told(pose);
}

static int demo(const double pose[6]) {
  double loads[${guard}_LOADS], validity, expected_error[${guard}_LOADS];
  ${name}_loads(pose, loads);
  ${name}_confidence(pose, &validity, expected_error);
  for (int i = 0; i < ${guard}_LOADS; i++) {
    printf("%-8s %14.6f %s", ${name}_load_names[i], loads[i], ${name}_load_units[i]);
    if (expected_error[i] == expected_error[i]) printf(" (expected error %.2g)", expected_error[i]);
    printf("\n");
  }
  return told(pose);
}

int main(int argc, char **argv) {
  double pose[6] = {$example_pose};
  int failed = 0, found;
  if (argc > 1 && strcmp(argv[1], "demo") == 0) return demo(pose);
  if (argc > 1) return fprintf(stderr, "got the argument %s, expected demo or poses on standard input\n", argv[1]), 2;
  while ((found = scanf("%lf %lf %lf %lf %lf %lf", pose, pose + 1, pose + 2, pose + 3, pose + 4, pose + 5)) == 6) {
    failed |= evaluate(pose);
  }
  if (found == EOF) return failed;
  fprintf(stderr, "got a pose of %d numbers, expected six\n", found);
  return 2;
}
