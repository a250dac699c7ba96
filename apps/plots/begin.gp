# This gnuplot script is a fixed text of liegrad. The command gnuplot -d ./NAME.gp > IMAGE draws the plot again.
# The script reads NAME.dat. Each line of block 0 is a text that begins with =. The blocks 1, 2, ... hold numbers.
# T[1], T[2], ... are the texts of this plot. V(k) is T[k] as a number. tic(text) is a text for `set xtics`, in which % begins a format.
# colour(1), colour(2), ... are the colours of classes and curves. small(text) is a font in which a long name fits beside an axis.
# Texts may hold any characters. They are shown with `noenhanced`, and are never part of a command.
set encoding utf8
datafile = ARG0[1:strlen(ARG0)-3].".dat"
if (datafile[1:1] ne "/") { datafile = "./".datafile }
set datafile commentschars ""
set datafile separator "\t"
stats datafile index 0 using (1) nooutput
array T[STATS_records]
count = -2
plot = ""
take(text) = (count = count + 1, count > 0 ? (T[count] = text) : count == 0 ? (plot = text) : 0, 1)
stats datafile index 0 using (take(strcol(1)[2:*])) nooutput
set datafile separator whitespace
set datafile commentschars
V(k) = real(T[k])
# finite(k, other): column k, or `other` if it is no finite number. `stats` fails if no number is left.
finite(k, other) = strstrt(strcol(k), "n") > 0 ? other : real(strcol(k))
# gnuplot cuts a tick label with % after 49 bytes. In a longer label the full-width percent sign stands for %.
percent(text, sign) = (out = "", sum [at = 1:strlen(text)] (out = out.(text[at:at] eq "%" ? sign : text[at:at]), 0), out)
ascii = ""
do for [k = 32:126] { ascii = ascii.sprintf("%c", k) }
bytes(text) = sum [at = 1:strlen(text)] (strstrt(ascii, text[at:at]) > 0 ? 1 : 4)
tic(text) = strstrt(text, "%") == 0 ? text : percent(text, bytes(text) < 50 ? "%%" : "％")
# `eval size(W, H)` begins a plot of this size in pixels.
size(w, h) = "set terminal ".(plot eq "svg" ? "svg" : "pngcairo")." size ".int(w).",".int(h). \
    (plot eq "svg" ? " dynamic background rgb 'white' font 'Helvetica,13'" : " font 'Helvetica,11'")
colour(k) = "#".word("1f5fa8 d1641f 2e8b57 8b3a8b b8860b 17a2b8 6b4423 5d6d7e 7cb342 e377c2", int(k - 1) % 10 + 1)
small(text) = strlen(text) > 16 ? ",7" : ""
# `eval unit` prepares a plot of the unit sphere, @sphere. `eval powers('xy')` makes axes logarithmic, with powers of ten.
unit = "set parametric; set urange [0:pi]; set vrange [0:2*pi]; set isosamples 25,13; set xrange [-1:1]; set yrange [-1:1]; set zrange [-1:1]"
sphere = "sin(u)*cos(v), sin(u)*sin(v), cos(u)"
powers(axes) = "set logscale ".axes.(strstrt(axes, "x") ? "; set format x '10^{%L}'" : "")."; set format y '10^{%L}'"
set grid lc rgb '#dddddd'
set border lc rgb '#555555'
