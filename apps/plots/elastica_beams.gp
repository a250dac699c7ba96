# Beams, with equal scales on both axes. T[1]: step of the tics of y, T[2]: title or nothing, T[3]: 1 with a legend, else 0,
# T[4]: number of beams, T[5]: width of the lines of minima. Then for each beam its legend, and 1 if it is a saddle, else 0.
# Columns: x, y. Index k: beam k.
set xlabel 'x'
set ylabel 'y'
set size ratio -1
set ytics V(1)
set offsets graph 0.03, graph 0.03, graph 0.05, graph 0.05
set title T[2]
if (V(3) > 0) { set key outside right top } else { unset key }
colour(k) = word('#1f5fa8 #d1641f #2e8b57 #8b3a8b #b8860b #c0392b #17a2b8 #6b4423 #5d6d7e #7cb342 #e377c2 #3f51b5', 1 + int(k - 1) % 12)
saddle(k) = V(4 + 2 * k + 1) > 0
plot for [k = 1:V(4)] datafile index k with lines lw (saddle(k) ? 1.5 : V(5)) dt 1 + saddle(k) lc rgb colour(k) title T[4 + 2 * k]
