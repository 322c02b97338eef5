"""C source for the loads and their Jacobian, with a small program that calls it (§3.5 exports C++)."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

import casadi as ca
import numpy as np

from casadi_contact.conventions import POSE_NAMES, load_unit
from casadi_contact.transcription.functions import check_name

_HEADER = """\
/* {description}
 * Plain C, no library but libm; thread-safe; no memory is allocated.
 * pose = ({pose}): mm and rad. loads = ({loads}): {units}. */
#ifndef {guard}_H
#define {guard}_H

#ifdef __cplusplus
extern "C" {{
#endif

#define {guard}_POSES 6
#define {guard}_LOADS {count}

extern const char *const {name}_load_names[{guard}_LOADS];

void {name}_loads(const double pose[6], double loads[{guard}_LOADS]);

/* jacobian[i][j] = d loads[i] / d pose[j], row after row. */
void {name}_jacobian(const double pose[6], double loads[{guard}_LOADS], double jacobian[{guard}_LOADS][6]);

#ifdef __cplusplus
}}
#endif

#endif
"""

_SOURCE = """\
#include "{name}.h"

#include "{name}_kernel.h"

const char *const {name}_load_names[{guard}_LOADS] = {{{names}}};

void {name}_loads(const double pose[6], double loads[{guard}_LOADS]) {{
  const double *inputs[{values_arg}] = {{pose}};
  double *outputs[{values_res}] = {{loads}};
  long long int iw[{values_iw}];
  double w[{values_w}];
  {name}_kernel_loads(inputs, outputs, iw, w, 0);
}}

void {name}_jacobian(const double pose[6], double loads[{guard}_LOADS], double jacobian[{guard}_LOADS][6]) {{
  const double *inputs[{jacobian_arg}] = {{pose}};
  double *outputs[{jacobian_res}] = {{loads, &jacobian[0][0]}};
  long long int iw[{jacobian_iw}];
  double w[{jacobian_w}];
  {name}_kernel_jacobian(inputs, outputs, iw, w, 0);
}}
"""

_EXAMPLE = """\
/* Reads poses (six numbers each: {pose}) from standard input, or takes a built-in one with the argument "demo";
 * prints the loads of each pose and then its Jacobian, one row per load. */
#include <stdio.h>
#include <string.h>

#include "{name}.h"

static void print_row(const double *values, int count) {{
  for (int i = 0; i < count; i++) printf("%.17g%c", values[i], i + 1 < count ? ' ' : '\\n');
}}

static void evaluate(const double pose[6]) {{
  double loads[{guard}_LOADS], jacobian[{guard}_LOADS][6];
  {name}_jacobian(pose, loads, jacobian);
  print_row(loads, {guard}_LOADS);
  for (int i = 0; i < {guard}_LOADS; i++) print_row(jacobian[i], 6);
}}

int main(int argc, char **argv) {{
  double pose[6] = {{{example_pose}}};
  if (argc > 1 && strcmp(argv[1], "demo") == 0) {{
    double loads[{guard}_LOADS];
    {name}_loads(pose, loads);
    for (int i = 0; i < {guard}_LOADS; i++) printf("%-8s %14.6f\\n", {name}_load_names[i], loads[i]);
    return 0;
  }}
  while (scanf("%lf %lf %lf %lf %lf %lf", pose, pose + 1, pose + 2, pose + 3, pose + 4, pose + 5) == 6) evaluate(pose);
  return 0;
}}
"""

# CasADi gives every generated function the same parameters, used or not.
_KERNEL_PREFIX = """\
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
"""

# No -ffast-math: in a shared library it turns denormal numbers off for the whole process.
_MAKEFILE = """\
CFLAGS ?= -O3 -fno-math-errno -fno-trapping-math -Wall -Wextra

example: example.o {name}.o {name}_kernel.o
\t$(CC) $(CFLAGS) -o $@ $^ -lm

clean:
\trm -f example *.o
"""


def export_c(
    loads: ca.Function,
    loads_and_jacobian: ca.Function,
    folder: str | Path,
    *,
    name: str,
    load_names: Sequence[str],
    example_pose: Sequence[float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    description: str = "Joint contact loads of a pose.",
) -> list[Path]:
    """Write ``name.c/.h`` (the API), ``name_kernel.c/.h`` (generated), ``example.c`` and ``Makefile``; return paths.

    loads is pose (6) -> loads (L); loads_and_jacobian is pose (6) -> loads (L), Jacobian (L x 6).
    Raises ValueError for functions of another shape or an unusable name, OSError where folder cannot be written.
    """
    check_name(name)
    count = len(load_names)
    if loads.size_in(0) != (6, 1) or loads.size_out(0) != (count, 1) or loads_and_jacobian.size_out(1) != (count, 6):
        raise ValueError(
            f"cannot export {loads} and {loads_and_jacobian}, expected pose (6) -> loads ({count}) and "
            f"pose (6) -> loads ({count}), jacobian ({count} x 6)"
        )
    pose = ca.MX.sym("pose", 6)
    value, jacobian = loads_and_jacobian(pose)
    kernels = {
        "values": ca.Function(f"{name}_kernel_loads", [pose], [ca.densify(loads(pose))]),
        # CasADi stores by columns and C by rows, hence the transpose.
        "jacobian": ca.Function(f"{name}_kernel_jacobian", [pose], [ca.densify(value), ca.densify(jacobian.T)]),
    }
    words = {
        "name": name,
        "guard": name.upper(),
        "count": count,
        "description": description.replace("*/", ""),
        "pose": ", ".join(POSE_NAMES),
        "loads": ", ".join(load_names),
        "units": ", ".join(load_unit(load) for load in load_names),
        "names": ", ".join(f'"{load}"' for load in load_names),
        "example_pose": ", ".join(repr(float(np.float64(value))) for value in example_pose),
    }
    for key, function in kernels.items():
        sizes = {"arg": function.sz_arg(), "res": function.sz_res(), "iw": function.sz_iw(), "w": function.sz_w()}
        words |= {f"{key}_{size}": str(max(1, number)) for size, number in sizes.items()}
    texts = {
        f"{name}.h": _HEADER,
        f"{name}.c": _SOURCE,
        "example.c": _EXAMPLE,
        "Makefile": _MAKEFILE,
    }
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder, prefix=".export-") as scratch:
        generator = ca.CodeGenerator(f"{name}_kernel.c", {"with_header": True})
        for function in kernels.values():
            generator.add(function)
        generator.generate(scratch + os.sep)
        kernel = Path(scratch) / f"{name}_kernel.c"
        kernel.write_text(_KERNEL_PREFIX + kernel.read_text(encoding="utf-8"), encoding="utf-8")
        for file_name, text in texts.items():
            (Path(scratch) / file_name).write_text(text.format(**words), encoding="utf-8")
        written = []
        for source in sorted(Path(scratch).iterdir()):
            os.replace(source, folder / source.name)
            written.append(folder / source.name)
    return written
