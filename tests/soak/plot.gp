# SPDX-License-Identifier: Apache-2.0
# Draws a table of a soak: gnuplot -c plot.gp TABLE.csv OUT.png FIRST_COLUMN LAST_COLUMN
set datafile separator ','
set key autotitle columnhead outside
set terminal pngcairo size 1000,600
set output ARG2
set xlabel 'exposures or seconds'
set logscale y
first = int(ARG3)
last = int(ARG4)
x = first > 2 && last == 7 ? 2 : 1
plot for [i = first:last] ARG1 using x:(abs(column(i)) > 0 ? abs(column(i)) : NaN) with lines
