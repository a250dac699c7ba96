/* lg-fit search: random search over the options of train. */
#include "common/search.h"

#include "lg-fit/fit.h"

static int search(app *self, const train_task *task) {
    return search_main(self, &train_command, task);
}

static int run(app *self) {
    return with_task(self, search);
}

const app_command search_command = {.name = "search",
                                    .arguments = "RANGES.yaml TABLE",
                                    .summary = "Random search over the options of train",
                                    .details = SEARCH_DETAILS,
                                    SEARCH_SHARED,
                                    .arguments_min = 2,
                                    .arguments_max = 2,
                                    .run = run};
