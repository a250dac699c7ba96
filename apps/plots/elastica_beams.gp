# Beams, with equal scales on both axes. T[1]: title, or nothing for thick lines, T[2]: 1 with a legend, else 0, or 2 for a learned
# curve. Then for each beam its legend, and 1 if it is a saddle, else 0; for a learned curve 1 with the solution, else 0.
# Columns: x, y. Index k: beam k; of a learned curve 1: its nodes, 2: the solution, or NaN.
learned = V(2) > 1
width = T[1] eq '' ? 2.5 : 1.3
n = learned ? 2 : (count - 2) / 2
# The curves are 720 pixels wide. The tics of y have about four steps, 1, 2 or 5 times a power of ten; fewer if the box is low.
stats datafile index 1:n using 1:2 nooutput
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
needed = V(2) == 1 ? 20 * n + 60 : learned ? pixels + 20 : 0
eval size(V(2) == 1 ? 1000 : 800, pixels < needed ? needed : pixels)
set xlabel 'x'
set ylabel 'y'
set size ratio -1
set offsets graph 0.03, graph 0.03, graph 0.05, graph 0.05
set title T[1]
if (V(2) == 0) { unset key }
if (V(2) == 1) { set key outside right top }
colour(k) = word('#1f5fa8 #d1641f #2e8b57 #8b3a8b #b8860b #c0392b #17a2b8 #6b4423 #5d6d7e #7cb342 #e377c2 #3f51b5', 1 + int(k - 1) % 12)
saddle(k) = V(2 + 2 * k) > 0
if (learned) {
    set key top center horizontal outside
    plot datafile index 2 with lines lw width lc rgb '#1f5fa8' title (V(3) > 0 ? 'solved' : ''), \
        datafile index 1 with linespoints pt 7 ps 0.5 lw 1 lc rgb '#d1641f' title 'learned'
} else {
    plot for [k = 1:n] datafile index k with lines lw (saddle(k) ? 1.5 : width) dt 1 + saddle(k) lc rgb colour(k) title T[1 + 2 * k]
}
