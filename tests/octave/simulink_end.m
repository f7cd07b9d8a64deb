function [path, number] = simulink_end(store, parent, text, side)
% One end of a line: a block of the system, and a port that it has.
cut = find(text == '/', 1, 'last');
path = [parent '/' text(1:cut - 1)];
number = str2double(text(cut + 1:end));
if ~simulink_has(store.blocks, path)
    error('stand_in:block', 'there is no block %s', path);
end
if ~(number >= 1 && number <= simulink_ports(store.blocks.(path), side) && number == round(number))
    error('stand_in:port', '%s has no port %s among its %s', path, text(cut + 1:end), side);
end
end
