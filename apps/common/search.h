/* What every `search` command shares: a search over the hyperparameters of its program's `train`. It can be
 * resumed and stops bad trials early. Also its options, table of trials, result and plot. */
#ifndef LG_APPS_SEARCH_H
#define LG_APPS_SEARCH_H

#include "common/sweep.h"
#include "common/train.h"

typedef struct search_values {
    const char *out;
    bool resume;
    uint64_t trials, jobs;
    uint32_t sampler;
    lg_reals rungs;
    double validation;
    trials_values shared;
} search_values;

extern search_values search_given;
extern const lg_field search_options[];
extern const app_plot_kind search_plots[];
#define SEARCH_SHARED APP_GIVEN(search_options, search_given)

/* The samplers are those of nn/search.h. */
#define SEARCH_SAMPLER(name, sentence) " With --sampler " #name " " sentence "."
#define SEARCH_DETAILS                                                                                       \
    "The file has `ranges`, options of train each with one of {uniform: [a, b]}, {log-uniform: [a, b]}, "    \
    "{integer: [a, b]}, {choice: [a, ...]}, and `fixed`, options with a value; an option that is in "        \
    "neither has the default of train. A trial that fails stays in the table as failed; the exit code is 4 " \
    "if no trial was finished. Ctrl-C keeps the finished trials and ends with exit code 130; --continue "    \
    "continues to the same table." LG_SAMPLERS(SEARCH_SAMPLER)

/* The fields of a command `search`, except its settings and `run`. `data`: the data arguments of the
 * program's train command, e.g. "DATA.h5". */
#define SEARCH_COMMAND(data)                                                                                 \
    .name = "search", .arguments = "RANGES.yaml " data, .plots = search_plots,                               \
    .summary = "Search over the options of train", .details = SEARCH_DETAILS, .together = APP_RANKS

/* Arguments of the command: RANGES.yaml DATA.h5. `train` is the command whose task is searched. */
void search_main(app *app, const app_command *train, train_task *task);

#endif
