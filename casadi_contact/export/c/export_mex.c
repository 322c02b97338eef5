/* MATLAB and Octave: mex ${name}_mex.c $name.c, or mkoctfile --mex ${name}_mex.c $name.c
 *
 * [loads, jacobian, roots, validity, expected_error, status] = ${name}_mex(poses)
 *
 * poses           6 x n: $pose
 * loads           $count x n: $loads
 * jacobian        $count x 6 x n, derivatives of loads by the pose [a load's unit per mm, per rad]
 * roots           $patch_count x n: signed root load of $patches [-]
 * validity        1 x n; expected_error $count x n, in the loads' units$no_confidence
 * status          1 x n: 0 fine; 1 a pose that the model is not made for ($learned): its numbers mean nothing;
 *                 2 NaN or infinity in the pose: all numbers are NaN */
#include "mex.h"

#include "$name.h"

static double *output(int count, mxArray **left, int which, mwSize rows, mwSize n) {
  if (which >= count && which > 0) return 0;
  left[which] = mxCreateDoubleMatrix(rows, n, mxREAL);
  return mxGetPr(left[which]);
}

static double *jacobian_output(int count, mxArray **left, mwSize n) {
  const mwSize size[3] = {${guard}_LOADS, 6, n};
  if (count < 2) return 0;
  left[1] = mxCreateNumericArray(3, size, mxDOUBLE_CLASS, mxREAL);
  return mxGetPr(left[1]);
}

void mexFunction(int nlhs, mxArray *plhs[], int nrhs, const mxArray *prhs[]) {
  if (nrhs != 1 || !mxIsDouble(prhs[0]) || mxIsComplex(prhs[0]) || mxIsSparse(prhs[0]) || mxGetM(prhs[0]) != 6) {
    mexErrMsgIdAndTxt("${name}:poses", "expected one real, full matrix of 6 rows: $pose");
  }
  if (nlhs > 6) mexErrMsgIdAndTxt("${name}:outputs", "%d outputs, expected 6 at most", nlhs);
  const mwSize n = mxGetNumberOfElements(prhs[0]) / 6;
  const double *poses = mxGetPr(prhs[0]);
  double *loads = output(nlhs, plhs, 0, ${guard}_LOADS, n), *jacobian = jacobian_output(nlhs, plhs, n);
  double *roots = output(nlhs, plhs, 2, ${guard}_PATCHES, n), *validity = output(nlhs, plhs, 3, 1, n);
  double *expected = output(nlhs, plhs, 4, ${guard}_LOADS, n), *status = output(nlhs, plhs, 5, 1, n);
  for (mwSize k = 0; k < n; k++) {
    double rows[${guard}_LOADS][6], slopes[${guard}_PATCHES][6], valid, errors[${guard}_LOADS];
    const double *pose = poses + 6 * k;
    ${name}_jacobian(pose, loads + ${guard}_LOADS * k, rows);
    for (int j = 0; jacobian && j < 6; j++) {
      for (int i = 0; i < ${guard}_LOADS; i++) jacobian[(6 * k + j) * ${guard}_LOADS + i] = rows[i][j];
    }
    if (roots) ${name}_roots(pose, roots + ${guard}_PATCHES * k, slopes);
    if (validity) ${name}_confidence(pose, &valid, errors);
    if (validity) validity[k] = valid;
    for (int i = 0; expected && i < ${guard}_LOADS; i++) expected[${guard}_LOADS * k + i] = errors[i];
    if (status) status[k] = ${name}_status(pose);
  }
}
