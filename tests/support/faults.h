/* Calls of the C library that fail on request, to see what the project makes of it.
 *
 * The code under test calls __wrap_NAME in place of NAME. Suites are linked with copies of the static
 * libraries in which objcopy has replaced the names (tests/CMakeLists.txt); calls in the tests are not
 * replaced. The programs in the folder `faulty` are linked with the linker's option --wrap. The table in
 * faults.c has the names and their classes. Calls are counted over all threads, from 1. */
#ifndef LG_FAULTS_H
#define LG_FAULTS_H

#include <stdbool.h>
#include <stdint.h>

/* MEMORY: functions that allocate (of libyaml, too), or start a thread or a process. FILES: functions that
 * open, read, write, lock, name or close files. HDF5: functions of HDF5, which only fail. CONFINE: functions
 * that restrict a process. */
typedef enum fault_class { FAULT_MEMORY, FAULT_FILES, FAULT_HDF5, FAULT_CONFINE, FAULT_CLASSES } fault_class;

/* FAIL: the call does nothing and returns an error; a function that closes closes, and returns an error.
 * SHORT: read and write move half of the bytes; other calls work. INTERRUPT: read and write fail with EINTR;
 * other calls work. */
typedef enum fault_way { FAULT_FAIL, FAULT_SHORT, FAULT_INTERRUPT } fault_way;

/* Makes calls `from` to `to` of the class fail and starts to count. from = 0: no call fails. */
void faults_arm(fault_class of, fault_way way, long from, long to);

/* After this, no call fails. The counts stay. */
void faults_disarm(void);

/* While `spared` is true, calls of this thread work and are not counted. */
void faults_spare(bool spared);

/* faults_calls: number of calls of the class since faults_arm. faults_hit: whether one of them went wrong. */
long faults_calls(fault_class of);
bool faults_hit(void);

/* From now on, before() is called before each call of the class FILES. NULL ends this. */
void faults_interpose(void (*before)(void));

/* Blocks that were allocated by calls of the table and are not freed. */
long faults_live(void);

/* Number of open identifiers of HDF5. */
long faults_identifiers(void);

/* From now on, the hash of the innermost frames of the stack is written to stacks[n - 1] at call n of the
 * class, for the first `room` calls. NULL ends this. */
void faults_note_stacks(fault_class of, uint64_t *stacks, long room);

/* Chooses at most `most` of `calls` calls: the first call of each stack, or some of these at equal distances
 * if there are more than `most`; then other calls at equal distances. stacks[noted] is from
 * faults_note_stacks. most = 0: only the first call of each stack. Writes the numbers of the calls to
 * chosen[calls], and returns how many there are. */
long faults_choose(const uint64_t *stacks, long noted, long calls, long most, long *chosen);

#endif
