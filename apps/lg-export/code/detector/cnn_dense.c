/* The output layer -> y (outputs). */
static void cnn_run_dense(const cnn_place *place, int slopes, real *y, real *work) {
    (void)slopes;
    dense(&cnn_output, work + place[BLOCKS].input, y);
}
