# Energies of equilibria against x. Columns: x, energy, 1 for saddles, else 0, branch (from 0). An empty line begins each branch,
# and each of its pieces of equal stability.
eval size(1000, 650)
set xlabel 'x / π'
set ylabel 'energy'
set xrange [0:2]
set xtics 0.25
set key outside top center horizontal
colour(b) = word('#1f5fa8 #d1641f #2e8b57 #8b3a8b #b8860b #c0392b #17a2b8 #6b4423 #5d6d7e #7cb342 #e377c2 #3f51b5', 1 + int(b) % 12)
rgb(b) = ('0x'.colour(b)[2:7]) + 0
stats datafile index 1 using (finite(3, 0)) nooutput
plot 1/0 with lines lw 2 lc rgb '#444444' title 'minima', \
    1/0 with lines lw 1.3 dt 2 lc rgb '#444444' title (STATS_sum > 0 ? 'saddles' : ''), \
    for [s = 0:1] datafile index 1 using ($1 / pi):($3 == s ? $2 : NaN):(rgb($4)) \
        with linespoints ps 0.4 pt 7 - s lw 2 - 0.7 * s dt 1 + s lc rgb variable notitle
