static void fill(real *memory, int count, real value) {
    int i;
    for (i = 0; i < count; i++) memory[i] = value;
}

static double norm(const real *a, int size) {
    double sum = 0;
    int i;
    for (i = 0; i < size; i++) sum += (double)a[i] * (double)a[i];
    return sqrt(sum);
}

static double distance(const real *a, const real *b, int size) {
    double sum = 0;
    int i;
    for (i = 0; i < size; i++) sum += ((double)a[i] - (double)b[i]) * ((double)a[i] - (double)b[i]);
    return sqrt(sum);
}

static double mean_norm(const function *f, const result *o) {
    double sum = 0;
    int v;
    for (v = 0; v < GOLDEN; v++) {
        const double own = norm(f->y + v * f->outputs + o->at, o->size);
        sum += own * own;
    }
    return sqrt(sum / (double)GOLDEN);
}

/* 1 when it is wrong. */
static int check(const function *f, const result *o) {
    static real got[3][LARGEST], work[2][NAME_WORK_SIZE];
    const double mean = mean_norm(f, o);
    double worst = 0;
    int v, k, near = 1, same = 1;
    for (v = 0; v < GOLDEN; v++) {
        const real *want = f->y + v * f->outputs + o->at, *x = f->x + v * f->inputs;
        const double own = norm(want, o->size), scale = own > mean ? own : mean;
        double error;
        for (k = 0; k < (o->number < 0 ? 2 : 3); k++) {
            fill(got[k], f->outputs, (real)NAN);
            fill(work[k % 2], NAME_WORK_SIZE, k == 1 ? (real)1e30 : (real)NAN);
            f->run(x, got[k], k == 2 ? o->number : -1, work[k % 2]);
            if (memcmp(got[0] + o->at, got[k] + o->at, (size_t)o->size * sizeof(real)) != 0) same = 0;
        }
        error = distance(got[0] + o->at, want, o->size);
        if (scale > 0) error /= scale;
        if (!(error <= f->tolerance)) near = 0;
        if (!(error <= worst)) worst = error;
    }
    printf("%-16s %-16s error %8.2e  tolerance %8.2e  %s\n", f->name, o->name, worst, f->tolerance,
           !near   ? "WRONG"
           : !same ? "DEPENDS ON THE CONTENTS OF WORK OR ON WHAT IS WANTED"
                   : "ok");
    return !near || !same;
}

int main(void) {
    int wrong = 0;
    const function *f;
    const result *o;
    for (f = functions; f->name != NULL; f++)
        for (o = f->output; o->name != NULL; o++) wrong += check(f, o);
    return wrong > 0;
}
