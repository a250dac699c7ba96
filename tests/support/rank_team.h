/* Ranks (liegrad/core.h) as threads of a test. team_run runs one function on each rank. The function returns
 * a status and must not use cmocka's assertions. */
#ifndef LG_RANK_TEAM_H
#define LG_RANK_TEAM_H

#include <pthread.h>
#include <string.h>

#include "liegrad/core.h"
#include "test_support.h"

enum { TEAM_MOST = 8 };

typedef struct rank_team rank_team;
typedef struct team_member {
    rank_team *team;
    lg_ranks ranks;
    const void *out; /* data that this rank sends in the current exchange */
    lg_status status;
    lg_error error;
} team_member;

struct rank_team {
    pthread_barrier_t barrier;
    team_member members[TEAM_MOST];
    lg_status (*run)(void *user, const lg_ranks *ranks, lg_error *error);
    void *user;
};

static inline size_t team_offset(const size_t *bytes, uint32_t rank) {
    size_t at = 0;
    for (uint32_t r = 0; r < rank; r++) at += bytes[r];
    return at;
}

static inline lg_status team_collect(void *user, const void *mine, void *all, const size_t *bytes) {
    team_member *self = user;
    rank_team *team = self->team;
    self->out = mine;
    (void)pthread_barrier_wait(&team->barrier);
    for (uint32_t r = 0; all != NULL && r < self->ranks.count; r++)
        if (team->members[r].out != (char *)all + team_offset(bytes, r) && bytes[r] > 0)
            memcpy((char *)all + team_offset(bytes, r), team->members[r].out, bytes[r]);
    (void)pthread_barrier_wait(&team->barrier);
    return LG_OK;
}

static inline lg_status team_gather(void *user, void *all, const size_t *bytes) {
    const team_member *self = user;
    return team_collect(user, (char *)all + team_offset(bytes, self->ranks.rank), all, bytes);
}

static inline void *team_thread(void *user) {
    team_member *self = user;
    self->status = self->team->run(self->team->user, &self->ranks, &self->error);
    return NULL;
}

/* Runs the function on `count` ranks. The status of each rank is then in team->members[rank].status. */
static inline void team_run(rank_team *team, uint32_t count,
                            lg_status (*run)(void *user, const lg_ranks *ranks, lg_error *error),
                            void *user) {
    pthread_t threads[TEAM_MOST];
    memset(team, 0, sizeof *team);
    team->run = run;
    team->user = user;
    (void)pthread_barrier_init(&team->barrier, NULL, count);
    for (uint32_t r = 0; r < count; r++) {
        team_member *m = &team->members[r];
        m->team = team;
        m->ranks = (lg_ranks){sizeof m->ranks, r, count, m, team_gather, team_collect, NULL};
        assert_int_equal(pthread_create(&threads[r], NULL, team_thread, m), 0);
    }
    for (uint32_t r = 0; r < count; r++) (void)pthread_join(threads[r], NULL);
    (void)pthread_barrier_destroy(&team->barrier);
}

#endif
