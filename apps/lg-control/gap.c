/* lg-control train: what the controller costs compared with the best inputs that a search finds. */
#include <math.h>
#include <stdlib.h>

#include "lg-control/control_app.h"

void control_tell_gap(const app *self, lg_policy *policy, size_t starts, uint64_t seed, double seconds,
                      app_json *out) {
    static const double much = 1.5;
    bool complete = true;
    APP_FREE lg_policy_gap *gap = app_alloc(starts + 1, sizeof *gap);
    APP_FREE double *ratio = app_alloc(starts + 1, sizeof *ratio);
    if (starts > 0)
        APP_MUST(self, lg_policy_find_gaps(policy, starts, seed, (int)self->threads, seconds, gap, &complete,
                                           &error));
    size_t worst = 0;
    for (size_t i = 0; i < starts; i++) {
        ratio[i] = gap[i].ratio;
        if (ratio[i] > ratio[worst]) worst = i;
    }
    const double largest = starts > 0 ? ratio[worst] : 0.0, median = lg_median(ratio, starts);
    if (starts > 0)
        app_result_line(
            out, "cost from %zu starts over the cost of the best inputs found: median %.3g, largest %.3g",
            starts, median, largest);
    app_result_rows(out, "optimality_gap");
    for (size_t i = 0; i < starts; i++) {
        app_json_open(out, NULL, '{');
        app_json_size(out, "start", i);
        app_json_real(out, "cost", gap[i].cost);
        app_json_real(out, "best", gap[i].best);
        app_json_real(out, "ratio", gap[i].ratio);
        app_json_reals(out, "errors", gap[i].errors, lg_policy_regulator_of(policy)->errors);
        app_json_close(out, '}');
    }
    app_result_rows_end(out);
    if (!complete)
        app_warn(self, "the search for better inputs was short of time, so the optimality gap may be larger");
    if (largest > much)
        app_warn(self,
                 "from start %zu the controller costs %.3g times as much as the best inputs found; try "
                 "another --seed, a "
                 "wider network or more steps (--finish)",
                 worst, largest);
}
