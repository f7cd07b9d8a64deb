function chart = subsasgn(chart, where, value)
if ~strcmp(where(1).type, '.') || ~strcmp(where(1).subs, 'Script') || ~ischar(value)
    error('stand_in:chart', 'a chart has no such property');
end
simulink_script(chart.path, value);
end
