/* Ranks (liegrad/core.h) as threads of a test. team_run runs one function on each rank. The function returns
 * a status and must not use cmocka's assertions. When one rank has returned, the exchanges of the other ranks
 * fail, as they do when a process of MPI has ended. */
#ifndef LG_RANK_TEAM_H
#define LG_RANK_TEAM_H

#include <pthread.h>
#include <stdbool.h>
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
    pthread_mutex_t mutex;
    pthread_cond_t changed;
    uint32_t count, here; /* ranks, and how many of them wait for the next meeting */
    uint64_t meetings;    /* how often all ranks have met */
    bool ended;           /* a rank has returned */
    team_member members[TEAM_MOST];
    lg_status (*run)(void *user, const lg_ranks *ranks, lg_error *error);
    void *user;
};

static inline size_t team_offset(const size_t *bytes, uint32_t rank) {
    size_t at = 0;
    for (uint32_t r = 0; r < rank; r++) at += bytes[r];
    return at;
}

/* Waits until all ranks are here. Returns false if one has returned. */
static inline bool team_meet(rank_team *team) {
    (void)pthread_mutex_lock(&team->mutex);
    const uint64_t before = team->meetings;
    if (++team->here == team->count) {
        team->here = 0;
        team->meetings++;
        (void)pthread_cond_broadcast(&team->changed);
    }
    while (team->meetings == before && !team->ended) (void)pthread_cond_wait(&team->changed, &team->mutex);
    const bool met = team->meetings != before;
    (void)pthread_mutex_unlock(&team->mutex);
    return met;
}

static inline lg_status team_collect(void *user, const void *mine, void *all, const size_t *bytes) {
    team_member *self = user;
    rank_team *team = self->team;
    self->out = mine;
    if (!team_meet(team)) return LG_FILE;
    for (uint32_t r = 0; all != NULL && r < self->ranks.count; r++)
        if (team->members[r].out != (char *)all + team_offset(bytes, r) && bytes[r] > 0)
            memcpy((char *)all + team_offset(bytes, r), team->members[r].out, bytes[r]);
    return team_meet(team) ? LG_OK : LG_FILE;
}

static inline lg_status team_gather(void *user, void *all, const size_t *bytes) {
    const team_member *self = user;
    return team_collect(user, (char *)all + team_offset(bytes, self->ranks.rank), all, bytes);
}

static inline void *team_thread(void *user) {
    team_member *self = user;
    rank_team *team = self->team;
    self->status = team->run(team->user, &self->ranks, &self->error);
    (void)pthread_mutex_lock(&team->mutex);
    team->ended = true;
    (void)pthread_cond_broadcast(&team->changed);
    (void)pthread_mutex_unlock(&team->mutex);
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
    team->count = count;
    (void)pthread_mutex_init(&team->mutex, NULL);
    (void)pthread_cond_init(&team->changed, NULL);
    for (uint32_t r = 0; r < count; r++) {
        team_member *m = &team->members[r];
        m->team = team;
        m->ranks = (lg_ranks){sizeof m->ranks, r, count, m, team_gather, team_collect, NULL};
        assert_int_equal(pthread_create(&threads[r], NULL, team_thread, m), 0);
    }
    for (uint32_t r = 0; r < count; r++) (void)pthread_join(threads[r], NULL);
    (void)pthread_cond_destroy(&team->changed);
    (void)pthread_mutex_destroy(&team->mutex);
}

#endif
