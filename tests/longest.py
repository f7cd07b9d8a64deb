"""The order in which the longest tests begin."""

#: Tests of `make slow` that take longest, by their durations: runs side by side begin with them.
LONGEST = (
    "test_in_three_dimensions[vgtu-piezo]",
    "test_commands_run_as_printed[run-the-piezo-stage.md]",
    "test_a_stage_is_analysed_in_the_page",
    "test_it_holds_in_space[part]",
    "test_commands_run_as_printed[finite-elements.md1]",
    "test_a_scale_is_centred_in_the_page",
    "test_stages_are_explored_in_the_page",
    "test_from_a_record_to_the_waveform_in_a_browser",
    "test_a_run_that_is_killed_again_and_again_ends_with_all_it_acquired[part]",
    "test_the_bench_is_sound_and_does_its_task",
    "test_a_record_outlives_its_page_and_its_server",
    "test_a_drawing_is_dropped_and_opened",
    "test_a_stage_is_designed_in_the_page",
    "test_a_3_rrr_in_space",
    "test_commands_run_as_printed[optimise.md]",
    "test_a_report_is_written_read_printed_and_kept_in_the_page",
)
