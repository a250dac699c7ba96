/* Probabilities and the class. */
static void extra(const NAME_real *x, NAME_real *out, NAME_real *work) {
    const int found = NAME_classify(x, out, work);
    out[NAME_CLASSES] = (NAME_real)(NAME_classify(x, 0, work) == found ? found : -1);
}
