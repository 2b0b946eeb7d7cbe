#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Jobs of `subview-lab tables` by a real Slurm of one node (slurmctld, slurmd and munge on
# loopback), whose daemons live in a folder of their own. Exit code 77 where that cannot be: not
# root, or not installed (tools/deps/install.sh slurm). usage: slurm.sh LAB
set -eu
lab=$(realpath "$1")
here=$(dirname "$(realpath "$0")")
tools=$(realpath "$here/../../tools/tables")
for p in slurmctld slurmd sbatch munged mungekey; do
  command -v $p >/dev/null || { echo "no $p here"; exit 77; }
done
[ "$(id -u)" = 0 ] || { echo "not root"; exit 77; }
d=$(mktemp -d /tmp/sv_slurm_XXXXXX)
pids=
finish() {
  [ -z "$pids" ] || kill $pids 2>/dev/null || true
  wait || true
  rm -rf "$d"
}
trap finish EXIT
cd "$d"
mkdir -p state spool
# munged wants its folders safe, and no others in them.
mungekey --create --keyfile="$d/munge.key"
chmod 755 "$d"
munged --foreground --force --key-file="$d/munge.key" --socket="$d/munge.sock" --pid-file="$d/munge.pid" \
  --log-file="$d/munge.log" --seed-file="$d/munge.seed" >munged.out 2>&1 &
pids="$pids $!"
host=$(hostname -s)
cpus=$(nproc)
cat >slurm.conf <<EOF
ClusterName=subview
SlurmctldHost=$host(127.0.0.1)
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket=$d/munge.sock
CredType=cred/munge
SlurmctldPort=16817
SlurmdPort=16818
StateSaveLocation=$d/state
SlurmdSpoolDir=$d/spool
SlurmctldPidFile=$d/slurmctld.pid
SlurmdPidFile=$d/slurmd.pid
SlurmctldLogFile=$d/slurmctld.log
SlurmdLogFile=$d/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
ReturnToService=2
SlurmdTimeout=30
KillWait=2
MaxArraySize=1001
NodeName=$host NodeAddr=127.0.0.1 CPUs=$cpus State=UNKNOWN
PartitionName=all Nodes=$host Default=YES State=UP
EOF
export SLURM_CONF=$d/slurm.conf
for i in $(seq 50); do [ -S munge.sock ] && break; sleep 0.1; done
slurmctld -D -f slurm.conf >ctld.out 2>&1 &
pids="$pids $!"
slurmd -D -f slurm.conf >slurmd.out 2>&1 &
pids="$pids $!"
for i in $(seq 100); do sinfo -h -o %t 2>/dev/null | grep -q idle && break; sleep 0.2; done
sinfo -h -o '%N %t'

"$lab" import --from sim textured,size=48x48 --out s --quiet
set -- --data s --quick --steps 3 --gaussians 40 --quiet
"$lab" tables "$@" --out sh --jobs 1
"$lab" tables "$@" --out slurm --plan jobs.txt
n=$(wc -l <jobs.txt)
# A node that is lost in the middle of a job loses that one: here its task is killed.
sed -i '1s/^/[ -e once ] || { : >once; kill -9 $PPID $$; }; /' jobs.txt
sbatch --wait --array=1-$n "$tools/tables.sbatch" jobs.txt >sbatch.out || true
"$lab" tables "${@:1:$#-1}" --out slurm --collect 2>collect.txt || true
grep -q "1 of $n runs are missing" collect.txt || { cat collect.txt; ls slurm/runs; exit 1; }
"$lab" tables "$@" --out slurm --plan jobs.txt
[ "$(wc -l <jobs.txt)" = 1 ]
sbatch --wait --array=1-1 "$tools/tables.sbatch" jobs.txt >sbatch.out
"$lab" tables "$@" --out slurm --collect
for t in summary depth init tv count exposures; do
  cmp <(cut -d, -f1-12 sh/$t.csv) <(cut -d, -f1-12 slurm/$t.csv)
done
echo "$n jobs by Slurm: the same tables as by a shell; a killed task was missing alone"
