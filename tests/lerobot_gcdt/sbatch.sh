# An imitation of sbatch: runs the ranks of an array one after the other, and only after what they depend on.
script=${!#}
[[ "$*" =~ --dependency=afterok:([0-9]+) ]] && [ ! -e "$JOBS/${BASH_REMATCH[1]} done" ] && exit 1
[[ "$(cat "$script")" =~ --array=0-([0-9]+) ]]
job=$(($(ls "$JOBS" | wc -l) + 1))
state=done
for rank in $(seq 0 "${BASH_REMATCH[1]}"); do
    SLURM_ARRAY_TASK_ID=$rank SLURM_NODELIST=here bash "$script" >&2 || state=failed
done
touch "$JOBS/$job $state"
echo "Submitted batch job $job"
