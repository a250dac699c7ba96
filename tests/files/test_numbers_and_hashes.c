/* SHA-256 for the test vectors of FIPS 180-4; conversion of texts to numbers. */
#include <locale.h>

#include "core/text.h"
#include "liegrad/settings.h"

#include "support/io_test.h"

static void hash_text(const char *text, size_t times, size_t piece, char out[LG_SHA256_TEXT]) {
    lg_sha256 state;
    lg_sha256_init(&state);
    size_t length = strlen(text);
    for (size_t i = 0; i < times; i++)
        for (size_t at = 0; at < length; at += piece)
            lg_sha256_add(&state, text + at, length - at < piece ? length - at : piece);
    lg_sha256_finish(&state, out);
}

TEST("SHA-256 gives the published hashes") {
    static const struct {
        const char *text;
        size_t times;
        const char *digest;
    } vectors[] = {
        {"", 1, "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"},
        {"abc", 1, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"},
        {"abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq", 1,
         "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1"},
        {"abcdefghbcdefghicdefghijdefghijkefghijklfghijklmghijklmnhijklmnoijklmnopjklmnopqklmnopqrlmnopqrsmno"
         "pqrstnopqrstu",
         1, "cf5b16a778af8380036ce59e7b0492370b249b11e8f07a51afac45037afee9d1"},
        {"aaaaaaaaaa", 100000, "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0"},
    };
    for (size_t i = 0; i < LG_COUNT(vectors); i++) {
        static const size_t pieces[] = {1, 3, 7, 64, 1000};
        for (size_t p = 0; p < LG_COUNT(pieces); p++) {
            char digest[LG_SHA256_TEXT];
            hash_text(vectors[i].text, vectors[i].times, pieces[p], digest);
            assert_string_equal(digest, vectors[i].digest);
        }
    }
}

TEST("a number must be the whole text and finite") {
    static const struct {
        const char *text;
        lg_status status;
        double value;
    } cases[] = {
        {"9.81", LG_OK, 9.81},
        {"-1e-3", LG_OK, -1e-3},
        {"+.5", LG_OK, 0.5},
        {"5.", LG_OK, 5},
        {"0", LG_OK, 0},
        {"1E+2", LG_OK, 100},
        {"1e-400", LG_OK, 0},
        {"007", LG_OK, 7},
        {"", LG_FORMAT, 0},
        {" 1", LG_FORMAT, 0},
        {"1 ", LG_FORMAT, 0},
        {"9,81", LG_FORMAT, 0},
        {"9.81m/s", LG_FORMAT, 0},
        {"0x10", LG_FORMAT, 0},
        {"nan", LG_FORMAT, 0},
        {"inf", LG_FORMAT, 0},
        {"1e", LG_FORMAT, 0},
        {"1e+", LG_FORMAT, 0},
        {".", LG_FORMAT, 0},
        {"-", LG_FORMAT, 0},
        {"1..2", LG_FORMAT, 0},
        {"--1", LG_FORMAT, 0},
        {"1e999", LG_NOT_FINITE, 0},
        {"1_000", LG_FORMAT, 0},
    };
    /* A locale with a decimal comma must not matter. If none is installed, the C locale stays. */
    (void)setlocale(LC_ALL, "de_DE.UTF-8");
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        double value = -77;
        if (lg_number_parse(cases[i].text, &value) != cases[i].status) fail_msg("'%s'", cases[i].text);
        assert_close(value, cases[i].status == LG_OK ? cases[i].value : -77, 0, 0);
    }
    (void)setlocale(LC_ALL, "C");
    uint64_t whole = 5;
    assert_ok(lg_integer_parse("18446744073709551615", &whole));
    assert_true(whole == UINT64_MAX);
    static const char *const refused[] = {
        "18446744073709551616", "99999999999999999999", "-1", "1.0", "", "1e3", " 1", "0x1"};
    for (size_t i = 0; i < LG_COUNT(refused); i++)
        assert_status(lg_integer_parse(refused[i], &whole), LG_FORMAT);
    assert_true(whole == UINT64_MAX);
}

TEST("a number at the beginning of a text is the one that strtod reads, and ends where it ends") {
    lg_rng rng;
    lg_rng_seed(&rng, 7, 0);
    for (int i = 0; i < 200000; i++) {
        char text[80] = "";
        const int whole = (int)lg_rng_below(&rng, 12), part = (int)lg_rng_below(&rng, 14);
        if (lg_rng_below(&rng, 2) > 0) lg_append(text, sizeof text, "-");
        for (int k = 0; k < whole; k++)
            lg_append(text, sizeof text, "%u", (unsigned)lg_rng_below(&rng, k > 0 ? 10 : 2));
        lg_append(text, sizeof text, whole == 0 || part > 0 ? "." : "");
        for (int k = 0; k < part || (k == 0 && whole == 0); k++)
            lg_append(text, sizeof text, "%u", (unsigned)lg_rng_below(&rng, 10));
        if (lg_rng_below(&rng, 2) > 0)
            lg_append(text, sizeof text, "e%d", (int)lg_rng_below(&rng, i % 9 > 0 ? 60 : 700) - 30);
        double value = 0;
        char *stop;
        lg_append(text, sizeof text, "%s", i % 3 == 0 ? ",5" : i % 3 == 1 ? "" : ".e1");
        const char *end = lg_decimal(text, &value);
        const double expected = lg_real(text, &stop);
        if (end != stop || value != expected || signbit(value) != signbit(expected))
            fail_msg("%s: %.17g, not %.17g", text, value, expected);
    }
    static const char *const none[] = {"", "-", ".", "e5", "1e", "1e+", "nan", "inf", " 1", ",1", "+-1"};
    double value;
    for (size_t i = 0; i < LG_COUNT(none); i++)
        if (lg_decimal(none[i], &value) != NULL) fail_msg("'%s'", none[i]);
}
