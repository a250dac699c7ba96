/* The plane and the output layer -> y (outputs). */
static void cnn_run_dense(const cnn_place *place, int slopes, real *y, real *work) {
    real *plane = work + place[BLOCKS].activated;
    dense(&cnn_plane, work + place[BLOCKS].input, plane);
    cnn_activate(slopes, cnn_plane.out, plane, work + place[BLOCKS].slope);
    dense(&cnn_output, plane, y);
}
