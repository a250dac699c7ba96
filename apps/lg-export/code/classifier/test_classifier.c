/* Scores, the class, and the features in units of their size. */
static void extra(const NAME_real *x, NAME_real *out, NAME_real *work) {
    NAME_real *features = out + NAME_CLASSES + 1;
    const int found = NAME_classify(x, out, work);
    out[NAME_CLASSES] = (NAME_real)(NAME_classify(x, NULL, work) == found ? found : -1);
    NAME_features(x, features, work);
    for (int i = 0; i < NAME_FEATURES; i++) features[i] *= feature_size[i];
}
