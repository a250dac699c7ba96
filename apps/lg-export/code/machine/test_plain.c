static void extra(const NAME_real *x, NAME_real *out, NAME_real *work) {
    motion(x, out, work);
}
