#include "autodiff/ops/conv_code.h"

#include "autodiff/ops/windows.h"

static const lg_c_fragment c_window_rows = {
    .comment = "Of window t: which of its rows lie in the series, and which row of the series is the first.",
    .text = LG_C(static void window_rows(const conv_windows *w, int t, int *first, int *rows, int *at) {
        const int start = t * w->stride - w->padding;
        const int begin = start < 0 ? -start : 0;
        const int end = start + w->size > w->length ? w->length - start : w->size;
        *first = begin;
        *rows = end > begin ? end - begin : 0;
        *at = start + begin;
    }),
    .needs = {&lg_c_windows}};

static const lg_c_fragment c_conv_tile = {.file = {"conv_tile", "conv_tile"}};

static const lg_c_fragment c_whole_windows = {
    .comment = "Windows first .. last - 1 lie in the series with all of their rows.",
    .text = LG_C(static void whole_windows(const conv_windows *w, int *first, int *last) {
        const int room = w->length + w->padding - w->size;
        *first = (w->padding + w->stride - 1) / w->stride;
        *last = room < 0 ? 0 : room / w->stride + 1;
        if (*last > w->count) *last = w->count;
        if (*last < *first) *first = *last;
    }),
    .needs = {&lg_c_windows}};

/* If the number of windows or columns is not a multiple of the tile size, the last tile is moved back and
 * computes some of them a second time. */
static const lg_c_fragment c_conv_tiles = {
    .comment =
        "y (count, outputs) = windows of x, `in` numbers one every `step`, times weight (in, outputs), "
        "plus b.",
    .text = LG_C(static NOINLINE void conv_tiles(int count, int in, int step, int outputs, const real *x,
                                                 const real *weight, const real *b, real *y) {
        for (int j = 0; j < outputs; j += TILE_COLUMNS) {
            const int o = j + TILE_COLUMNS > outputs ? outputs - TILE_COLUMNS : j;
            for (int i = 0; i < count; i += TILE_PLACES) {
                const int t = i + TILE_PLACES > count ? count - TILE_PLACES : i;
                conv_tile(in, step, outputs, outputs, x + t * step, weight + o, b != NULL ? b + o : tile_zero,
                          y + t * outputs + o);
            }
        }
    }),
    .needs = {&c_conv_tile}};

const lg_c_fragment lg_c_conv1d = {
    .comment = "y (batch, count, outputs) = the windows of x times w (size, channels, outputs), plus b "
               "(outputs; or NULL)",
    .text = LG_C(static NOINLINE void conv1d(int batch, conv_windows w, int outputs, const real *x,
                                             const real *weight, const real *b, real *y) {
        const int n = w.channels;
        int from, to;
        whole_windows(&w, &from, &to);
        const int tiled = to - from >= TILE_PLACES && outputs >= TILE_COLUMNS;
        for (int s = 0; s < batch; s++, x += w.length * n, y += w.count * outputs) {
            if (tiled)
                conv_tiles(to - from, w.size * n, w.stride * n, outputs,
                           x + (from * w.stride - w.padding) * n, weight, b, y + from * outputs);
            for (int t = 0; t < w.count; t++) {
                int first, rows, at;
                if (tiled && t == from) t = to;
                if (t == w.count) break;
                window_rows(&w, t, &first, &rows, &at);
                for (int o = 0; o < outputs; o++) y[t * outputs + o] = b != NULL ? b[o] : REAL(0.0);
                dense_add(rows * n, outputs, weight + first * n * outputs, x + at * n, y + t * outputs);
            }
        }
    }),
    .needs = {&c_window_rows, &c_whole_windows, &c_conv_tiles, &lg_c_dense_add}};

/* The columns of the panel are rows of the weight, so a tile of x's cotangent is one product computed by
 * conv_tile. */
static const lg_c_fragment c_conv_panel = {
    .comment = "Rows row .. row + 7 of weight (in, outputs) as columns, outputs o .. o + rows - 1; zeros for "
               "rows before\n`from`.",
    .text = LG_C(enum {PANEL_ROWS = 12};

                 static NOINLINE void conv_panel(int row, int from, int outputs, int o, int rows,
                                                 const real *weight, real *panel) {
                     for (int j = 0; j < TILE_COLUMNS; j++)
                         for (int k = 0; k < rows; k++)
                             panel[k * TILE_COLUMNS + j] =
                                 row + j < from ? REAL(0.0) : weight[(row + j) * outputs + o + k];
                 }),
    .needs = {&c_conv_tile}};

static const lg_c_fragment c_conv_panel_add = {
    .comment = "x += g times a panel at `count` places, a multiple of a tile's; what they cover may overlap.",
    .text = LG_C(static NOINLINE void conv_panel_add(int count, int step, int outputs, int rows,
                                                     const real *panel, const real *g, real *x) {
        real sum[TILE_PLACES * TILE_COLUMNS];
        for (int i = 0; i < count; i += TILE_PLACES) {
            conv_tile(rows, outputs, TILE_COLUMNS, TILE_COLUMNS, g + i * outputs, panel, tile_zero, sum);
            for (int t = 0; t < TILE_PLACES; t++, x += step)
                for (int j = 0; j < TILE_COLUMNS; j++) x[j] += sum[t * TILE_COLUMNS + j];
        }
    }),
    .needs = {&c_conv_panel}};

static const lg_c_fragment c_conv_back = {
    .comment = "x += g (count, outputs) times the transpose of weight (in, outputs), at places `step` apart; "
               "count is a\nmultiple of a tile's places.",
    .text = LG_C(static NOINLINE void conv_back(int count, int in, int step, int outputs, const real *g,
                                                const real *weight, real *x) {
        real panel[PANEL_ROWS * TILE_COLUMNS];
        for (int i = 0; i < in; i += TILE_COLUMNS) {
            const int row = i + TILE_COLUMNS > in ? in - TILE_COLUMNS : i;
            for (int o = 0; o < outputs; o += PANEL_ROWS) {
                const int rows = outputs - o < PANEL_ROWS ? outputs - o : PANEL_ROWS;
                conv_panel(row, i, outputs, o, rows, weight, panel);
                conv_panel_add(count, step, outputs, rows, panel, g + o, x + row);
            }
        }
    }),
    .needs = {&c_conv_panel_add}};

const lg_c_fragment lg_c_conv1d_input = {
    .comment = "x (batch, length, channels), the adjoint of conv1d in its first argument: g (batch, count, "
               "outputs)",
    .text = LG_C(static NOINLINE void conv1d_input(int batch, conv_windows w, int outputs, const real *g,
                                                   const real *weight, real *x) {
        const int n = w.channels;
        int from, to;
        whole_windows(&w, &from, &to);
        if (w.size * n < TILE_COLUMNS) to = from;
        to = from + (to - from) / TILE_PLACES * TILE_PLACES;
        for (int s = 0; s < batch; s++, x += w.length * n, g += w.count * outputs) {
            for (int i = 0; i < w.length * n; i++) x[i] = REAL(0.0);
            if (to > from)
                conv_back(to - from, w.size * n, w.stride * n, outputs, g + from * outputs, weight,
                          x + (from * w.stride - w.padding) * n);
            for (int t = 0; t < w.count; t++) {
                int first, rows, at;
                if (t == from) t = to;
                if (t == w.count) break;
                window_rows(&w, t, &first, &rows, &at);
                for (int i = 0; i < rows * n; i++)
                    x[at * n + i] += dot(outputs, weight + (first * n + i) * outputs, g + t * outputs);
            }
        }
    }),
    .needs = {&c_window_rows, &c_whole_windows, &c_conv_back, &lg_c_dot}};

const lg_c_fragment lg_c_conv1d_weight = {
    .comment = "weight (size, channels, outputs), the adjoint of conv1d in its second argument: x, g",
    .text = LG_C(static NOINLINE void conv1d_weight(int batch, conv_windows w, int outputs,
                                                    const real *RESTRICT x, const real *RESTRICT g,
                                                    real *RESTRICT weight) {
        const int n = w.channels;
        for (int i = 0; i < w.size * n * outputs; i++) weight[i] = REAL(0.0);
        for (int s = 0; s < batch; s++, x += w.length * n)
            for (int t = 0; t < w.count; t++, g += outputs) {
                int first, rows, at;
                window_rows(&w, t, &first, &rows, &at);
                for (int i = 0; i < rows * n; i++)
                    for (int o = 0; o < outputs; o++)
                        weight[(first * n + i) * outputs + o] += x[at * n + i] * g[o];
            }
    }),
    .needs = {&c_window_rows}};
