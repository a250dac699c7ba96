/* Recordings on tapes that run out of memory at any point. */
#ifndef LG_NARROW_TAPE_H
#define LG_NARROW_TAPE_H

#include "support/fixtures.h"

/* Records something on the tape and returns the tape's status. */
typedef lg_status (*narrow_recording)(lg_tape *tape, const void *user);

/* Makes the recording on tapes with more and more room for values, 576 bytes at a time up to 64 KB: it must
 * run out of memory until it succeeds. Returns how often it has failed. */
static inline size_t record_narrow(lg_dtype dtype, narrow_recording record, const void *user) {
    enum {
        CHUNK = 1 << 16,
        STEP = 9 * 64
    }; /* a tape's first chunk of values; the second one is twice as large */
    lg_tape_options options;
    lg_tape *tape = NULL;
    size_t failures = 0;
    lg_tape_options_init(&options);
    options.dtype = dtype;
    options.max_size = 180000; /* one chunk, and many nodes without values */
    assert_ok(lg_tape_create(NULL, &options, &tape));
    lg_test_owns(tape, release_tape);
    for (size_t room = STEP; room < CHUNK; room += STEP, failures++) {
        void *values;
        lg_tape_reset(tape);
        (void)lg_input_buffer(tape, lg_shape1((uint32_t)((CHUNK - room) / (dtype == LG_F64 ? 8 : 4))),
                              &values);
        const lg_status status = record(tape, user);
        if (status == LG_OK) break;
        assert_int_equal(status, LG_OUT_OF_MEMORY);
        assert_int_equal(lg_tape_status(tape), LG_OUT_OF_MEMORY);
    }
    return failures;
}

#endif
