# A decision tree, down to a level. T[1]: levels, T[2]: nodes of the whole tree; then for each box the name of its column or class, and
# what follows it (`with labels` would read quotes and backslashes in a name).
# Columns, a line for each box: x, level, class (1, 2, ...), fraction of its samples in this class, x of both children.
stats datafile index 1 using 1:2 nooutput
boxes = STATS_records
leaves = int(STATS_max_x) + 1
levels = int(STATS_max_y)
eval size(160 + 150*leaves, 120 + 96*levels)
array X[boxes]
array Y[boxes]
stats datafile index 1 using (X[$0 + 1] = $1):(Y[$0 + 1] = $2) nooutput
channel(rgb, k) = ('0x'.rgb[2*k:2*k + 1]) + 0
pale(rgb, part) = sum [k = 1:3] int(255.5 - part*(255 - channel(rgb, k)))*256**(3 - k)
short(text) = text[1:40]
unset key
unset border
unset tics
unset grid
if (V(1) > levels) { set title sprintf('the first %d of %d levels, %d nodes', levels, V(1), V(2)) }
set xrange [-0.7:leaves - 0.3]
set yrange [levels + 0.5:-0.5]
set for [k = 1:boxes] label short(T[2*k + 1]).T[2*k + 2] at X[k],Y[k] center noenhanced font ',8' front offset 0,0.4
plot for [side = 5:6] datafile index 1 using 1:2:(column(side) - $1):(1) with vectors nohead lc rgb '#666666', \
    datafile index 1 using 1:2:(0.47):(0.25):(pale(colour($3), 0.1 + 0.6*$4)) \
        with boxxyerror fs solid 1 border lc rgb '#444444' lc rgb variable
