/* Windows of a log that judge machines and do not train them. */
#include <math.h>

#include "machine/files/choice.h"

/* ---- the length of windows ---- */

/* Rows in which a number changes by its size, at most `most`. */
static size_t rows_of_change(const lg_machine *machine, const lg_machine_log *log, size_t i, size_t most) {
    const double size = lg_log_variance(machine, log, i);
    size_t lag = 1;
    while (lag < most && lg_log_change(machine, log, i, lag) < size) lag = lag + lag / 4 + 1;
    return lag < most ? lag : most;
}

static size_t choose_steps(const lg_machine *machine, const lg_machine_log *log, double part, size_t windows,
                           size_t before) {
    enum { TIMES = 10, LEAST = 100 };
    const size_t typical = log->rows / log->parts;
    size_t most = (size_t)(part * (double)log->rows / (double)windows), slowest = 1;
    if (typical < before + LG_HELD_OUT_DELAY + 2) return 0;
    if (most > typical - before - LG_HELD_OUT_DELAY - 1) most = typical - before - LG_HELD_OUT_DELAY - 1;
    for (size_t i = 0; i < machine->positions + machine->velocities; i++) {
        const size_t rows = rows_of_change(machine, log, i, most);
        if (rows > slowest) slowest = rows;
    }
    const size_t wanted = TIMES * slowest > LEAST ? TIMES * slowest : LEAST;
    return wanted < most ? wanted : most;
}

/* ---- the plan ---- */

/* One in `every` of the tiles of `steps` rows into which the parts are cut. Tiles begin at complete
 * rows. */
static void place_windows(const lg_machine *machine, const lg_machine_log *log, double every,
                          lg_held_out *out) {
    const size_t before = out->before;
    double tile = floor(every / 2);
    out->count = 0;
    for (lg_log_part p = {0}; lg_log_next(log, &p);)
        for (size_t row = p.first + before + LG_HELD_OUT_DELAY; row + out->steps < p.end; row += out->steps) {
            if (fmod(tile++, every) >= 1 ||
                !lg_machine_log_complete(machine, log, row - before, out->estimated))
                continue;
            out->start[out->count++] = row;
        }
}

/* Sets the weights of the numbers from their changes in the windows. Velocities count only where no position
 * is measured. */
static void find_weights(const lg_machine *machine, const lg_machine_log *log, lg_held_out *out) {
    const size_t nq = machine->positions, n = nq + machine->velocities;
    bool any = false;
    for (size_t i = 0; i < n && !(i == nq && any); i++) {
        lg_squares s = {0, 0};
        for (size_t w = 0; w < out->count; w++)
            for (size_t j = 1; j <= out->steps; j++)
                lg_squares_add(&s, lg_log_number(machine, log, out->start[w] + j, i) -
                                       lg_log_number(machine, log, out->start[w], i));
        if (s.sum > 0) out->weight[i] = (double)s.count / s.sum;
        any = any || s.sum > 0;
    }
}

lg_status lg_held_out_plan(const lg_context *context, const lg_machine *machine, const lg_machine_log *log,
                           double part, size_t windows, bool estimated, lg_held_out *out, lg_error *error) {
    enum { LEAST_STEPS = 5, LEAST_WINDOWS = 4 };
    *out = (lg_held_out){.estimated = estimated, .context = context};
    if (estimated) out->before = lg_start_rows(machine) - 1;
    out->steps = choose_steps(machine, log, part, windows, out->before);
    if (out->steps < LEAST_STEPS) return LG_OK;
    out->start = lg_alloc(context, log->rows / LEAST_STEPS + 1, sizeof *out->start);
    if (out->start == NULL) return lg_no_memory(error);
    for (;; out->steps -= (out->steps + 7) / 8) { /* ends of parts may have no room for a window */
        place_windows(machine, log, fmax(1.0, 1 / part), out);
        if (out->count >= windows || out->steps <= LEAST_STEPS + 1) break;
    }
    if (out->count < LEAST_WINDOWS) out->count = 0;
    find_weights(machine, log, out);
    return LG_OK;
}

void lg_held_out_destroy(lg_held_out *held) {
    lg_free(held->context, held->start);
    *held = (lg_held_out){.count = 0};
}

bool lg_held_out_has(const lg_held_out *held, size_t row, size_t rows) {
    size_t low = 0; /* the first window that ends at or after `row` */
    for (size_t step = held->count; step > 0; step /= 2)
        while (low + step <= held->count && held->start[low + step - 1] + held->steps < row) low += step;
    return low < held->count && held->start[low] + 1 < row + rows;
}

/* Finds the row of `to` with the time and run of a row of `from`. Returns to->log.rows if no row has them. */
static size_t same_row(const lg_logs *from, size_t row, const lg_logs *to) {
    const size_t part = lg_machine_log_part(&from->log, row);
    const double t = from->log.t[row];
    for (size_t p = 0; p < to->log.parts; p++) {
        if (to->part_run[p] != from->part_run[part]) continue;
        for (size_t k = to->log.first[p]; k < to->log.first[p + 1]; k++)
            if (to->log.t[k] == t) return k;
    }
    return to->log.rows;
}

lg_status lg_held_out_match(const lg_held_out *held, const lg_logs *from, const lg_logs *to, lg_held_out *out,
                            lg_error *error) {
    const size_t before = held->before;
    *out = *held;
    out->start = lg_alloc(held->context, held->count, sizeof *out->start);
    if (out->start == NULL) return lg_no_memory(error);
    for (size_t w = 0; w < held->count; w++) {
        const size_t row = same_row(from, held->start[w], to), rows = to->log.rows;
        const size_t part = row < rows ? lg_machine_log_part(&to->log, row) : 0;
        out->start[w] = row;
        if (row == rows || row < to->log.first[part] + before || row + held->steps >= to->log.first[part + 1])
            return lg_fail(error, LG_FORMAT, "rows of the windows that judge are missing in this log");
    }
    return LG_OK;
}

/* ---- comparing ---- */

/* Student's quantile that a mean exceeds by chance once in 200 times, rounded up: 2.6 for many windows. */
static double student(size_t count) {
    return 2.6 * (1.0 + 4.0 / (double)(count - 1));
}

/* The probability of at least `wins` heads in n throws of a coin. */
static double sign_test(double n, double wins) {
    double sum = 0;
    for (double k = wins; k <= n; k++)
        sum += exp(lgamma(n + 1) - lgamma(k + 1) - lgamma(n - k + 1) - n * log(2));
    return sum;
}

lg_held_out_ratio lg_held_out_compare(size_t count, const double *square, const double *than) {
    static const double least = 1e-300, few = 24, rare = 0.005, less = 0.95;
    double sums[2] = {0, 0}, mean = 0, spread = 0, used = 0, wins = 0;
    for (size_t i = 0; i < count; i++) {
        if (isnan(square[i]) || isnan(than[i])) continue;
        const double d = log(fmax(square[i], least)) - log(fmax(than[i], least)), step = d - mean;
        sums[0] += square[i];
        sums[1] += than[i];
        used++;
        wins += d < 0;
        mean += step / used;
        spread += step * (d - mean);
    }
    lg_held_out_ratio out = {.ratio = sqrt(sums[0] / sums[1])};
    if (used < 2 || !isfinite(sums[0])) return out;
    /* Gains of very different sizes have a large spread; of few windows the signs then say more. */
    out.better = !isfinite(sums[1]) ||
                 (out.ratio < 1 && (-mean > student((size_t)used) * sqrt(spread / (used - 1) / used) ||
                                    (used < few && sign_test(used, wins) < rare)));
    out.clear = out.better && out.ratio < less;
    return out;
}

double lg_held_out_error(const lg_held_out *held, const double *square) {
    double sum = 0, count = 0;
    for (size_t i = 0; i < held->count; i++)
        if (!isnan(square[i])) sum += square[i], count++;
    return sqrt(sum / count);
}
