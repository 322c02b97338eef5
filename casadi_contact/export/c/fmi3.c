/* FMI 3.0 for model exchange and co-simulation of $name: inputs are the pose, outputs the loads and root loads, which
 * follow the inputs at once; there is no state. Validity and expected errors can be read beside them. The types are
 * those of the standard: an instance is a pointer, a value reference uint32_t, a status int. */
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "$name.h"

#if defined(_WIN32)
#define FMI __declspec(dllexport)
#else
#define FMI
#endif

#define TOKEN "$token"
#define LOADS ${guard}_LOADS
#define PATCHES ${guard}_PATCHES

/* value references, in this order */
enum { TIME, POSE, FIRST_LOAD = POSE + 6, FIRST_ROOT = FIRST_LOAD + LOADS, VALIDITY = FIRST_ROOT + PATCHES,
       FIRST_ERROR, LAST = VALIDITY + LOADS };
enum { OK, WARNING, DISCARD, ERROR };

typedef void (*Log)(void *environment, int status, const char *category, const char *message);

typedef struct {
  double time, pose[6];
  void *environment;
  Log log;
  bool told;
} Instance;

static const double start[6] = {$start};

static int say(Instance *of, int status, const char *message) {
  if (of->log) of->log(of->environment, status, status == WARNING ? "logStatusWarning" : "logStatusError", message);
  return status;
}

/* What the model's own status means to a simulation; a pose out of range is told once per visit. */
static int status_of(Instance *of) {
  const int status = ${name}_status(of->pose);
  if (status == ${guard}_NOT_FINITE) return say(of, DISCARD, "the pose is not finite");
  if (status == ${guard}_OUTSIDE && !of->told) {
    say(of, WARNING, "the pose is out of the model's range ($learned): its loads mean nothing");
  }
  of->told = status == ${guard}_OUTSIDE;
  return of->told ? WARNING : OK;
}

/* ---- life */

FMI const char *fmi3GetVersion(void) { return "3.0"; }

FMI int fmi3Reset(void *instance) {
  Instance *of = instance;
  of->time = 0.0, of->told = false;
  memcpy(of->pose, start, sizeof start);
  return OK;
}

static void *new_instance(const char *token, void *environment, Log log) {
  Instance *made;
  if (!token || strcmp(token, TOKEN) != 0) {
    if (log) log(environment, ERROR, "logStatusError", "the instantiation token is not that of this model");
    return 0;
  }
  made = calloc(1, sizeof *made);
  if (!made) return 0;
  made->environment = environment, made->log = log;
  fmi3Reset(made);
  return made;
}

FMI void *fmi3InstantiateModelExchange(const char *name, const char *token, const char *resources, bool visible,
                                       bool logging, void *environment, Log log) {
  (void)name, (void)resources, (void)visible, (void)logging;
  return new_instance(token, environment, log);
}

FMI void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                      bool logging, bool events, bool early, const uint32_t *intermediate, size_t n,
                                      void *environment, Log log, void (*update)(void)) {
  (void)name, (void)resources, (void)visible, (void)logging, (void)events, (void)early, (void)intermediate, (void)n;
  (void)update;
  return new_instance(token, environment, log);
}

FMI void fmi3FreeInstance(void *instance) { free(instance); }

FMI int fmi3EnterInitializationMode(void *instance, bool tolerant, double tolerance, double from, bool ends, double end) {
  return (void)tolerant, (void)tolerance, (void)ends, (void)end, ((Instance *)instance)->time = from, OK;
}

#define NOTHING_TO_DO(function) \
  FMI int function(void *instance, ...) { return (void)instance, OK; }
NOTHING_TO_DO(fmi3SetDebugLogging) NOTHING_TO_DO(fmi3ExitInitializationMode) NOTHING_TO_DO(fmi3EnterEventMode)
NOTHING_TO_DO(fmi3Terminate) NOTHING_TO_DO(fmi3EnterConfigurationMode) NOTHING_TO_DO(fmi3ExitConfigurationMode)
NOTHING_TO_DO(fmi3EvaluateDiscreteStates) NOTHING_TO_DO(fmi3EnterContinuousTimeMode) NOTHING_TO_DO(fmi3EnterStepMode)

FMI int fmi3UpdateDiscreteStates(void *instance, bool *again, bool *terminate, bool *nominals, bool *values, bool *defined,
                                 double *next) {
  return (void)instance, (void)next, *again = *terminate = *nominals = *values = *defined = false, OK;
}

/* ---- values */

FMI int fmi3SetFloat64(void *instance, const uint32_t *references, size_t n, const double *values, size_t count) {
  Instance *of = instance;
  if (count != n) return say(of, ERROR, "one value is expected for each reference");
  for (size_t i = 0; i < n; i++) {
    if (references[i] < POSE || references[i] >= FIRST_LOAD) return say(of, ERROR, "only the pose can be set");
    of->pose[references[i] - POSE] = values[i];
  }
  return OK;
}

FMI int fmi3GetFloat64(void *instance, const uint32_t *references, size_t n, double *values, size_t count) {
  Instance *of = instance;
  double loads[LOADS], roots[PATCHES], slopes[PATCHES][6], validity, errors[LOADS];
  bool loaded = false, rooted = false, confident = false;
  if (count != n) return say(of, ERROR, "one value is expected for each reference");
  for (size_t i = 0; i < n; i++) {
    const uint32_t k = references[i];
    if (k > LAST) return say(of, ERROR, "there is no variable of this reference");
    if (k < FIRST_LOAD) {
      values[i] = k == TIME ? of->time : of->pose[k - POSE];
      continue;
    }
    if (!loaded) ${name}_loads(of->pose, loads), loaded = true;
    if (k >= VALIDITY && !confident) ${name}_confidence(of->pose, &validity, errors), confident = true;
    else if (k >= FIRST_ROOT && k < VALIDITY && !rooted) ${name}_roots(of->pose, roots, slopes), rooted = true;
    values[i] = k < FIRST_ROOT ? loads[k - FIRST_LOAD]
                               : (k < VALIDITY ? roots[k - FIRST_ROOT] : (k == VALIDITY ? validity : errors[k - FIRST_ERROR]));
  }
  return loaded ? status_of(of) : OK;
}

/* Products with d unknown / d known, from the loads' and roots' own Jacobians; rows are output variables, columns the
 * pose: of the unknowns, or (adjoint) of the knowns. */
static int derivatives(Instance *of, const uint32_t *unknowns, size_t n, const uint32_t *knowns, size_t m,
                       const double *seed, size_t seeds, double *products, size_t count, bool adjoint) {
  double rows[LOADS + PATCHES][6];
  const int status = status_of(of);
  ${name}_roots(of->pose, (double[PATCHES]){0}, rows + LOADS);
  ${name}_jacobian(of->pose, (double[LOADS]){0}, rows);
  if (status > WARNING) return status;
  if (seeds != (adjoint ? n : m) || count != (adjoint ? m : n)) return say(of, ERROR, "seeds or results do not fit");
  for (size_t i = 0; i < n; i++) {
    if (unknowns[i] < FIRST_LOAD || unknowns[i] >= VALIDITY) return say(of, ERROR, "derivatives are those of loads");
  }
  for (size_t j = 0; j < m; j++) {
    if (knowns[j] < POSE || knowns[j] >= FIRST_LOAD) return say(of, ERROR, "derivatives are by the pose");
  }
  for (size_t k = 0; k < count; k++) {
    products[k] = 0.0;
    for (size_t l = 0; l < seeds; l++) {
      const uint32_t unknown = unknowns[adjoint ? l : k], known = knowns[adjoint ? k : l];
      products[k] += rows[unknown - FIRST_LOAD][known - POSE] * seed[l];
    }
  }
  return status;
}

#define DERIVATIVE(function, adjoint) \
  FMI int function(void *of, const uint32_t *unknowns, size_t n, const uint32_t *knowns, size_t m, const double *seed, \
                   size_t seeds, double *products, size_t count) { \
    return derivatives(of, unknowns, n, knowns, m, seed, seeds, products, count, adjoint); \
  }
DERIVATIVE(fmi3GetDirectionalDerivative, false)
DERIVATIVE(fmi3GetAdjointDerivative, true)

/* ---- model exchange: no states, no events */

FMI int fmi3SetTime(void *instance, double time) { return ((Instance *)instance)->time = time, OK; }
FMI int fmi3CompletedIntegratorStep(void *instance, bool final, bool *event, bool *terminate) {
  return (void)instance, (void)final, *event = *terminate = false, OK;
}
FMI int fmi3GetNumberOfContinuousStates(void *instance, size_t *count) { return (void)instance, *count = 0, OK; }
FMI int fmi3GetNumberOfEventIndicators(void *instance, size_t *count) { return (void)instance, *count = 0, OK; }

#define NO_STATES(function, type) \
  FMI int function(void *instance, type *values, size_t n) { \
    return (void)values, n ? say(instance, ERROR, #function ": there are none") : OK; \
  }
NO_STATES(fmi3SetContinuousStates, const double) NO_STATES(fmi3GetContinuousStates, double)
NO_STATES(fmi3GetContinuousStateDerivatives, double) NO_STATES(fmi3GetNominalsOfContinuousStates, double)
NO_STATES(fmi3GetEventIndicators, double)

/* ---- co-simulation: a step only passes the time */

FMI int fmi3DoStep(void *instance, double from, double step, bool final, bool *event, bool *terminate, bool *early,
                   double *reached) {
  Instance *of = instance;
  (void)final;
  of->time = *reached = from + step;
  *event = *terminate = *early = false;
  return OK;
}

/* ---- what this model has not: other types of variables, clocks, stored states, scheduling. No parameter but the instance
 * is read, so that none other is declared. */

#define UNSUPPORTED(function) \
  FMI int function(void *instance, ...) { return say(instance, ERROR, #function " is not supported"); }
#define NO_VARIABLES(type) UNSUPPORTED(fmi3Get##type) UNSUPPORTED(fmi3Set##type)
NO_VARIABLES(Float32) NO_VARIABLES(Boolean) NO_VARIABLES(String) NO_VARIABLES(Binary) NO_VARIABLES(Clock)
NO_VARIABLES(Int8) NO_VARIABLES(Int16) NO_VARIABLES(Int32) NO_VARIABLES(Int64)
NO_VARIABLES(UInt8) NO_VARIABLES(UInt16) NO_VARIABLES(UInt32) NO_VARIABLES(UInt64)
NO_VARIABLES(IntervalDecimal) NO_VARIABLES(IntervalFraction) NO_VARIABLES(ShiftDecimal) NO_VARIABLES(ShiftFraction)
NO_VARIABLES(FMUState) UNSUPPORTED(fmi3FreeFMUState) UNSUPPORTED(fmi3SerializedFMUStateSize)
UNSUPPORTED(fmi3SerializeFMUState) UNSUPPORTED(fmi3DeserializeFMUState) UNSUPPORTED(fmi3ActivateModelPartition)
UNSUPPORTED(fmi3GetNumberOfVariableDependencies) UNSUPPORTED(fmi3GetVariableDependencies)
UNSUPPORTED(fmi3GetOutputDerivatives)

FMI void *fmi3InstantiateScheduledExecution(const char *name, ...) { return (void)name, (void *)0; }
