#include "liegrad/core.h"

#include <stdint.h>
#include <string.h>

#include "core/core.h"

void lg_ranks_part(uint32_t rank, uint32_t count, size_t total, size_t *first, size_t *end) {
    const size_t each = total / count, more = total % count;
    *first = rank * each + rank * more / count;
    *end = (rank + 1) * each + (rank + 1) * more / count;
}

/* Up to this number of ranks, an exchange needs no memory from the heap. A rank that runs out of memory must
 * not skip an exchange: the other ranks would wait for its message, or would take its next message for the
 * missing one. */
enum { FEW = 4096 };

static size_t *list_of(const lg_ranks *ranks, size_t few[FEW]) {
    if (ranks->count > FEW) return lg_alloc(NULL, ranks->count, sizeof *few);
    memset(few, 0, ranks->count * sizeof *few);
    return few;
}

static lg_status gather(const lg_ranks *ranks, void *all, size_t *list, const size_t few[FEW]) {
    const lg_status status = ranks->gather(ranks->user, all, list);
    if (list != few) lg_free(NULL, list);
    return status;
}

lg_status lg_ranks_share(const lg_ranks *ranks, uint32_t from, void *data, size_t bytes) {
    LG_NEEDS(NULL, ranks, data);
    size_t few[FEW], *list = list_of(ranks, few);
    if (list == NULL) return LG_OUT_OF_MEMORY;
    list[from] = bytes;
    return gather(ranks, data, list, few);
}

lg_status lg_ranks_gather_parts(const lg_ranks *ranks, size_t total, size_t item, void *all) {
    size_t few[FEW], *list = list_of(ranks, few);
    if (list == NULL) return LG_OUT_OF_MEMORY;
    for (uint32_t r = 0; r < ranks->count; r++) {
        size_t first, end;
        lg_ranks_part(r, ranks->count, total, &first, &end);
        list[r] = (end - first) * item;
    }
    return gather(ranks, all, list, few);
}

lg_status lg_ranks_lost(const lg_ranks *ranks, lg_status status, lg_error *error) {
    const char *why = ranks->reason != NULL ? ranks->reason(ranks->user) : NULL;
    return lg_fail(error, status, "%s", why != NULL ? why : "the ranks lost their connection");
}

/* Rank `from` has failed with this status. Its message is copied to all ranks. */
static lg_status tell(const lg_ranks *ranks, uint32_t from, lg_status status, lg_error *error) {
    char message[sizeof error->message] = "";
    if (from == ranks->rank && error != NULL) memcpy(message, error->message, sizeof message);
    const lg_status exchanged = lg_ranks_share(ranks, from, message, sizeof message);
    if (exchanged != LG_OK) return lg_ranks_lost(ranks, exchanged, error);
    message[sizeof message - 1] = '\0';
    return lg_fail(error, status, from == ranks->rank ? "%s" : "%s (rank %u)", message, from);
}

lg_status lg_ranks_agree(const lg_ranks *ranks, lg_status status, lg_error *error) {
    LG_NEEDS(error, ranks);
    uint32_t few[FEW] = {0}, failed = 0;
    uint32_t *all = ranks->count > FEW ? lg_alloc(NULL, ranks->count, sizeof *all) : few;
    if (all == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for the statuses of the ranks");
    all[ranks->rank] = (uint32_t)status;
    lg_status first = lg_ranks_gather_parts(ranks, ranks->count, sizeof *all, all);
    if (first != LG_OK) (void)lg_ranks_lost(ranks, first, error);
    while (failed < ranks->count && all[failed] == LG_OK) failed++;
    if (first == LG_OK && failed < ranks->count) first = tell(ranks, failed, (lg_status)all[failed], error);
    if (all != few) lg_free(NULL, all);
    return first;
}
