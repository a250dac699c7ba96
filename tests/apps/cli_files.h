/* Files of the test's folder, read as objects of the running test. */
#ifndef LG_CLI_FILES_H
#define LG_CLI_FILES_H

#include "cli_support.h"

#include "liegrad/io.h"
#include "support/fixtures.h"

OWNED(lg_trajectories, lg_trajectories_destroy)
OWNED(lg_hamiltonian_file, lg_hamiltonian_file_destroy)

static inline lg_trajectories *cli_trajectories(const char *name) {
    char path[1024];
    lg_trajectories data;
    cli_path(name, path, sizeof path);
    assert_ok(lg_trajectories_read(NULL, path, NULL, &data, NULL));
    return own_lg_trajectories(data);
}

static inline lg_hamiltonian_file *cli_hamiltonian(const char *name) {
    char path[1024];
    lg_hamiltonian_file file;
    cli_path(name, path, sizeof path);
    assert_ok(lg_model_load_hamiltonian(NULL, path, NULL, &file, NULL));
    return own_lg_hamiltonian_file(file);
}

#endif
