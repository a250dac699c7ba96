# A learned curve, with equal scales on both axes. T[1]: 1 with the solution, else 0.
# Columns: x, y. index 1: the learned curve, 2: the solution, if there is one.
# The curves are 720 pixels wide. The tics of y have about four steps, 1, 2 or 5 times a power of ten; fewer if the box is low.
stats datafile index 1:1 + V(1) using 1:2 nooutput
dx = STATS_max_x - STATS_min_x < 1e-6 ? 1e-6 : STATS_max_x - STATS_min_x
dy = STATS_max_y - STATS_min_y
between(x, low, high) = x < low ? low : x > high ? high : x
pixels = int(between(1.12 * 720 * dy / dx, 120, 800)) + 110
dy = dy < 1e-6 ? 1e-6 : dy
rough = dy / between(20 * dy / dx, 1, 4)
power = 10**floor(log10(rough))
lead = rough / power
step = (lead < 1.5 ? 1 : lead < 3.5 ? 2 : lead < 7.5 ? 5 : 10) * power
set ytics step
eval size(800, pixels + 20)
set xlabel 'x'
set ylabel 'y'
set size ratio -1
set offsets graph 0.03, graph 0.03, graph 0.05, graph 0.05
set key top center horizontal outside
plot for [k = 2:1 + V(1)] datafile index k with lines lw 2.5 lc rgb '#1f5fa8' title 'solved', \
    datafile index 1 with linespoints pt 7 ps 0.5 lw 1 lc rgb '#d1641f' title 'learned'
