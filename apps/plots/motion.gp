# A moving chain or moving quadrotors in space. T[1]: chain or quadrotors, T[2]: links, then the title of each snapshot. index 1: the path, x y z. Then a block for each snapshot: x y z of the masses, or the beginning x y z and the vector of each line.
# For quadrotors e3 points down: the plot has the axes e1, -e2 and -e3.
eval size(900, 760)
count = count - 2
quadrotors = T[1] eq 'quadrotors'
turned(i, x) = quadrotors && i > 1 ? -x : x
array low[3]
array high[3]
do for [i = 1:3] {
    stats datafile index 1:count + 1 using (turned(i, column(i))) nooutput
    low[i] = STATS_min
    high[i] = STATS_max
    if (quadrotors) {
        stats datafile index 2:count + 1 using (turned(i, column(i) + column(3 + i))) nooutput
        low[i] = low[i] < STATS_min ? low[i] : STATS_min
        high[i] = high[i] > STATS_max ? high[i] : STATS_max
    }
}
longest = 1e-3
do for [i = 1:3] { longest = high[i] - low[i] > longest ? high[i] - low[i] : longest }
# Each side is at least a third of the longest one, with a small margin.
do for [i = 1:3] {
    middle = 0.5*(low[i] + high[i])
    half = 0.53*(high[i] - low[i] > longest/3 ? high[i] - low[i] : longest/3)
    low[i] = middle - half
    high[i] = middle + half
}
longest = 1.06*longest
# About five tics on the longest axis.
power = 10**floor(log10(longest / 5))
distance = longest / 5 > 5*power ? 10*power : longest / 5 > 2*power ? 5*power : longest / 5 > power ? 2*power : power
# From light to dark with time.
part(light, dark, k) = int(light + (count > 1 ? (k - 1.0) / (count - 1) : 1) * (dark - light) + 0.5)
shade(k) = 65536*part(190, 16, k) + 256*part(210, 54, k) + part(235, 104, k)
set tics nomirror
set view equal xyz
set xyplane relative 0
set xrange [low[1]:high[1]]
set yrange [low[2]:high[2]]
set zrange [low[3]:high[3]]
set xtics distance
set ytics distance
set ztics distance
set border 31 lc rgb '#bbbbbb'
set tics textcolor rgb '#555555'
set key at screen 0.98,0.93 right top vertical samplen 2 nobox
if (T[1] eq 'chain') {
    set title V(2) > 1 ? 'the chain, and the path of its last mass' : 'the pendulum and its path'
    set view 68,30,1.15
    set xlabel 'x [m]'
    set ylabel 'y [m]'
    set zlabel 'z [m]' rotate
    splot datafile index 1 using 1:2:3 with lines lw 0.8 lc rgb '#d1641f' title 'path', \
        for [k = 1:count] datafile index k+1 using 1:2:3 with linespoints lw 2 pt 7 ps (V(2) > 10 ? 0.4 : 0.8) lc rgb shade(k) title T[2 + k]
} else {
    set title 'payload, links and quadrotors; up is -e_{3}'
    set view 75,20,1.15
    set xlabel 'e_{1}  [m]'
    set ylabel '-e_{2}  [m]'
    set zlabel '-e_{3}  [m]' rotate
    splot datafile index 1 using 1:(-$2):(-$3) with lines lw 1.2 lc rgb '#d1641f' title 'payload', \
        for [k = 1:count] datafile index k+1 using 1:(-$2):(-$3):4:(-$5):(-$6) with vectors nohead lw 2 lc rgb shade(k) title T[2 + k]
}
