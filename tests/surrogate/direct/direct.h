FUNCTION void kernel_value(const double *pose, double *loads, double *roots) {
  double y[NETWORKS];
  networks_value(pose, y);
  for (int m = 0; m < NETWORKS; m++) {
    if (loads && LOAD_OF_NETWORK[m] >= 0) loads[LOAD_OF_NETWORK[m]] = y[m];
    if (roots && ROOT_OF_NETWORK[m] >= 0) roots[ROOT_OF_NETWORK[m]] = -y[m] / REFERENCE_LOAD;
  }
}

FUNCTION void kernel_jacobian(const double *pose, double *loads, double *roots, double (*loads_jacobian)[6],
                              double (*roots_jacobian)[6]) {
  double y[NETWORKS], dy[NETWORKS][6];
  networks_gradient(pose, y, dy[0]);
  for (int m = 0; m < NETWORKS; m++) {
    const int load = LOAD_OF_NETWORK[m], root = ROOT_OF_NETWORK[m];
    if (loads && load >= 0) {
      loads[load] = y[m];
      memcpy(loads_jacobian[load], dy[m], sizeof dy[m]);
    }
    if (roots && root >= 0) {
      roots[root] = -y[m] / REFERENCE_LOAD;
      for (int j = 0; j < 6; j++) roots_jacobian[root][j] = -dy[m][j] / REFERENCE_LOAD;
    }
  }
}

FUNCTION void kernel_hessian(const double *pose, const double *loads_weight, const double *roots_weight,
                             double *hessian) {
  double c[NETWORKS], y[NETWORKS], g[6] = {0}, h[36] = {0};
  for (int m = 0; m < NETWORKS; m++) {
    const int load = LOAD_OF_NETWORK[m], root = ROOT_OF_NETWORK[m];
    c[m] = (load >= 0 && loads_weight ? loads_weight[load] : 0.0) - (roots_weight && root >= 0 ? roots_weight[root] / REFERENCE_LOAD : 0.0);
  }
  networks_hessian(pose, c, y, g, h);
  for (int i = 0; i < 6; i++) {
    for (int j = 0; j < 6; j++) hessian[6 * i + j] = i < j ? h[6 * j + i] : h[6 * i + j];
  }
}
