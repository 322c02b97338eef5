/* Functions of FMI 3.0 for what this model has not: other types of variables, clocks, stored states, scheduling. */
static int unsupported(void *instance, const char *function) { return say(instance, ERROR, function); }

#define ANY __attribute__((unused))

#define NO_VARIABLES(Type, type) \
  FMI int fmi3Get##Type(void *of, ANY const uint32_t *references, ANY size_t n, ANY type *values, ANY size_t count) { \
    return unsupported(of, "fmi3Get" #Type ": there are no such variables"); \
  } \
  FMI int fmi3Set##Type(void *of, ANY const uint32_t *references, ANY size_t n, ANY const type *values, \
                        ANY size_t count) { \
    return unsupported(of, "fmi3Set" #Type ": there are no such variables"); \
  }
NO_VARIABLES(Float32, float)
NO_VARIABLES(Int8, int8_t)
NO_VARIABLES(UInt8, uint8_t)
NO_VARIABLES(Int16, int16_t)
NO_VARIABLES(UInt16, uint16_t)
NO_VARIABLES(Int32, int32_t)
NO_VARIABLES(UInt32, uint32_t)
NO_VARIABLES(Int64, int64_t)
NO_VARIABLES(UInt64, uint64_t)
NO_VARIABLES(Boolean, bool)
NO_VARIABLES(String, const char *)

#define UNSUPPORTED(function, ...) \
  FMI int function(void *of, __VA_ARGS__) { return unsupported(of, #function " is not supported"); }
UNSUPPORTED(fmi3GetBinary, ANY const uint32_t *r, ANY size_t n, ANY size_t *s, ANY const uint8_t **v, ANY size_t c)
UNSUPPORTED(fmi3SetBinary, ANY const uint32_t *r, ANY size_t n, ANY const size_t *s, ANY const uint8_t *const *v,
            ANY size_t c)
UNSUPPORTED(fmi3GetClock, ANY const uint32_t *r, ANY size_t n, ANY bool *v)
UNSUPPORTED(fmi3SetClock, ANY const uint32_t *r, ANY size_t n, ANY const bool *v)
UNSUPPORTED(fmi3GetNumberOfVariableDependencies, ANY uint32_t r, ANY size_t *n)
UNSUPPORTED(fmi3GetVariableDependencies, ANY uint32_t r, ANY size_t *i, ANY uint32_t *d, ANY size_t *j, ANY int *k,
            ANY size_t n)
UNSUPPORTED(fmi3GetFMUState, ANY void **state)
UNSUPPORTED(fmi3SetFMUState, ANY void *state)
UNSUPPORTED(fmi3FreeFMUState, ANY void **state)
UNSUPPORTED(fmi3SerializedFMUStateSize, ANY void *state, ANY size_t *size)
UNSUPPORTED(fmi3SerializeFMUState, ANY void *state, ANY uint8_t *bytes, ANY size_t size)
UNSUPPORTED(fmi3DeserializeFMUState, ANY const uint8_t *bytes, ANY size_t size, ANY void **state)
UNSUPPORTED(fmi3GetIntervalDecimal, ANY const uint32_t *r, ANY size_t n, ANY double *i, ANY int *q)
UNSUPPORTED(fmi3GetIntervalFraction, ANY const uint32_t *r, ANY size_t n, ANY uint64_t *c, ANY uint64_t *s, ANY int *q)
UNSUPPORTED(fmi3GetShiftDecimal, ANY const uint32_t *r, ANY size_t n, ANY double *s)
UNSUPPORTED(fmi3GetShiftFraction, ANY const uint32_t *r, ANY size_t n, ANY uint64_t *c, ANY uint64_t *s)
UNSUPPORTED(fmi3SetIntervalDecimal, ANY const uint32_t *r, ANY size_t n, ANY const double *i)
UNSUPPORTED(fmi3SetIntervalFraction, ANY const uint32_t *r, ANY size_t n, ANY const uint64_t *c, ANY const uint64_t *s)
UNSUPPORTED(fmi3SetShiftDecimal, ANY const uint32_t *r, ANY size_t n, ANY const double *s)
UNSUPPORTED(fmi3SetShiftFraction, ANY const uint32_t *r, ANY size_t n, ANY const uint64_t *c, ANY const uint64_t *s)
UNSUPPORTED(fmi3GetOutputDerivatives, ANY const uint32_t *r, ANY size_t n, ANY const int32_t *o, ANY double *v,
            ANY size_t c)
UNSUPPORTED(fmi3ActivateModelPartition, ANY uint32_t clock, ANY double time)

FMI void *fmi3InstantiateScheduledExecution(ANY const char *name, ANY const char *token, ANY const char *resources,
                                            ANY bool visible, ANY bool logging, ANY void *environment, ANY Log log,
                                            ANY void (*update)(void), ANY void (*lock)(void),
                                            ANY void (*unlock)(void)) {
  return 0;
}
