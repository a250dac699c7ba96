/* Reads files in the test's folder into objects that the running test owns. */
#ifndef LG_CLI_FILES_H
#define LG_CLI_FILES_H

#include "cli_support.h"

#include "liegrad/hamiltonian.h"
#include "support/fixtures.h"

OWNED(lg_trajectories, lg_trajectories_destroy)
OWNED_FILE(hamiltonian)

static inline lg_trajectories *cli_trajectories(const char *name) {
    lg_trajectories data;
    assert_ok(lg_trajectories_read(NULL, cli_at(name), NULL, &data, NULL));
    return own_lg_trajectories(data);
}

static inline lg_hamiltonian_file *cli_hamiltonian(const char *name) {
    lg_hamiltonian_file file;
    assert_ok(lg_recipe_load(NULL, cli_at(name), NULL, &lg_recipe_hamiltonian, &file, NULL));
    return own_lg_hamiltonian_file(file);
}

#endif
