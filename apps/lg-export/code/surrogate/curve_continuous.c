void NAME_curve(const NAME_real *x, const NAME_real *s, int points, NAME_real *q, NAME_real *v,
                NAME_real *work) {
    for (int i = 0; i < points; i++) {
        if (v != NULL)
            NAME_point(s + i, x, q != NULL ? q + 2 * i : NULL, v + 2 * i, work);
        else if (q != NULL)
            NAME_place(s + i, x, q + 2 * i, work);
    }
}
