function root = sfroot()
root = stateflow_root();
end
