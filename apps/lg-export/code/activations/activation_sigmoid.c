/* z <- sigmoid(z) = 1/(1 + exp(-z)) */
static void activate(int n, real *z) {
    for (int i = 0; i < n; i++) z[i] = sigmoid_of(z[i]);
}
