/* A library beside the kernel's: the interface of casadi.external for as many poses as the name of its file says, x101-... for
 * 101. Copies of it under other names serve other numbers; the kernel's own library is the same for all. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <string.h>

#define INLINE static inline __attribute__((always_inline, unused))
#define FRAMES frames()

void guarded_value(const double *pose, double *loads, double *roots);
void guarded_jacobian(const double *pose, double *loads, double *roots, double (*loads_jacobian)[VARIABLES],
                      double (*roots_jacobian)[VARIABLES]);
void guarded_hessian(const double *pose, const double *loads_weight, const double *roots_weight, double *hessian);
void values_of(long long n, const double *poses, double *loads, double *roots);

static long long frames(void) {
  static long long known;
  Dl_info library;
  if (!known && dladdr(&known, &library)) {
    const char *name = strrchr(library.dli_fname, '/');
    known = name && name[1] == 'x' ? atoll(name + 2) : 1;
  }
  return known;
}
