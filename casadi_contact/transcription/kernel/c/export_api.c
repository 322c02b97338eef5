
#include "$name.h"

const char *const ${name}_load_names[${guard}_LOADS] = {$names};

void ${name}_loads(const double pose[6], double loads[${guard}_LOADS]) { guarded_value(pose, loads, 0); }

void ${name}_jacobian(const double pose[6], double loads[${guard}_LOADS], double jacobian[${guard}_LOADS][6]) {
  guarded_jacobian(pose, loads, 0, jacobian, 0);
}

void ${name}_hessian(const double pose[6], const double weights[${guard}_LOADS], double hessian[6][6]) {
  guarded_hessian(pose, weights, 0, &hessian[0][0]);
}
