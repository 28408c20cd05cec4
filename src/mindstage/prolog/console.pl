% Entry points called by Python: set-up of module `user`, running goals with limits, interrupts and exit.

:- module(mindstage_console, [start/1, solve/4, solve_query/4, consult_file/2, on_interrupt/2]).
:- use_module(questions).
:- use_module(line_queries).
:- use_module(prefixes).
:- use_module(rdf_mirror, [mark_stale/0]).
:- use_module(semweb, []).
:- use_module(owl_predicates, []).
:- use_module(user_files, []).
:- use_module(veit2019_compat, []).
:- use_module(knowrob_objects, []).
:- use_module(knowrob_language, []).
:- use_module(plans, []).
:- use_module(robots, []).
:- use_module(episodes, []).
:- use_module(library(apply)).
:- use_module(library(error)).
:- use_module(library(lists)).
:- use_module(library(prolog_wrap)).
:- use_module(library(yall)).
:- use_module(library(time)).

% start(-Alarm): called for each console. Alarm is nudge if SIGUSR2 wakes Prolog without ending the process, else none.
start(Alarm) :-
    on_signal(usr2, Handler, Handler),
    (   Handler == default -> Alarm = none ; Alarm = nudge ),
    create_user_module,
    request(prefixes, Pairs),
    set_default_prefixes(Pairs),
    define_questions,
    mark_stale.

% The modules whose predicates users call; the first one that exports a name provides it.
user_module(mindstage_veit2019_compat).
user_module(mindstage_knowrob_objects).
user_module(mindstage_knowrob_language).
user_module(mindstage_plans).
user_module(mindstage_robots).
user_module(mindstage_episodes).
user_module(mindstage_semweb).
user_module(mindstage_owl).
user_module(mindstage_user_files).

create_user_module :- module_property(mindstage, exports(_)), import_module(user, mindstage), !.
create_user_module :-
    forall(( user_module(Module), module_property(Module, exports(Names)) ),
           forall(member(Name, Names), mindstage:import(Module:Name))),
    forall(member(Name, [questions/0, why/1, missing/2, ask_sentence/2, ask_sentence/3]), mindstage:import(mindstage_questions:Name)),
    delete_import_module(mindstage, user),
    add_import_module(mindstage, system, start),
    add_import_module(user, mindstage, start).

% -- goals -------------------------------------------------------------------------------------------------------------

% solve(+Text, +Limit, +Seconds, -End): End is found(Names, Rows, Complete), error_reply(Kind, Sentence), timed_out
% or interrupted. Names are those of the variables, and a row has their values. Complete is false if the search stopped at the limit and the goal had choice points left.
solve(Text, Limit, Seconds, End) :-
    catch(solutions(Text, Limit, Seconds, End), Error, error_end(Error, End)),
    flush_output(user_output).

solutions(Text, Limit, Seconds, found(Names, Rows, Complete)) :-
    term_string(Goal, Text, [variable_names(Variables), module(user)]),
    (   Goal == end_of_file -> syntax_error(end_of_file) ; true ),
    call_with_time_limit(Seconds, collect(user:Goal, Limit, Variables, user, Names, Rows, Complete)).

% solve_query(+Text, +Limit, +Seconds, -End): the same for a query of an untrusted client, with a memory limit.
solve_query(Text, Limit, Seconds, End) :-
    current_prolog_flag(stack_limit, Before),
    max_memory_bytes(Bytes),
    Limit0 is min(Before, Bytes),
    setup_call_cleanup(
        set_prolog_flag(stack_limit, Limit0),
        catch(query_solutions(Text, Limit, Seconds, End), Error, error_end(Error, End)),
        set_prolog_flag(stack_limit, Before)).

max_memory_bytes(33554432).

query_solutions(Text, Limit, Seconds, found(Names, Rows, Complete)) :-
    query_goal(Text, Variables, Goal),
    call_with_time_limit(Seconds, collect(call_bounded(Goal), Limit, Variables, client, Names, Rows, Complete)).

% -- answers -----------------------------------------------------------------------------------------------------------

% collect(:Goal, +Limit, +Variables, +Whom, -Names, -Rows, -Complete): the values of the variables in each solution. Solutions
% are measured one by one, because findall/3 keeps them outside of the stacks, which alone have a memory limit.
collect(Goal, Limit, Variables, Whom, Names, Rows, Complete) :-
    max_characters(Whom, Most),
    exclude(is_hidden, Variables, Shown),
    maplist([Name=Value, Name, Value]>>true, Shown, Names, Values),
    State = state(Most, 0, true),
    findall(Values, ( limited(Goal, Limit, State), is_convertible(Whom, Variables), measure(Values, State) ), Solutions),
    arg(3, State, Complete),
    maplist(maplist(cell), Solutions, Rows).

is_hidden(Name=_) :- sub_atom(Name, 0, _, _, '_').

% limited(:Goal, +Limit, !State): as limit/2; the third argument of State becomes false if solutions may be left.
limited(Goal, Limit, State) :-
    call_cleanup(Goal, Ended = true),
    arg(2, State, Before),
    Count is Before + 1,
    nb_setarg(2, State, Count),
    (   Count < Limit -> true
    ;   (   Ended == true -> true ; nb_setarg(3, State, false) ),
        !  % which runs the cleanup
    ).

% Solutions with cyclic terms are dropped for untrusted clients; there, they can arise from X = f(X) only.
is_convertible(client, Variables) :- acyclic_term(Variables).
is_convertible(user, _).

% max_characters(+Whom, -Most): the limit of the text of all solutions together.
max_characters(user, 256000000).
max_characters(client, 4000000).

max_parts(2000000).

% measure(+Term, !State): throws if a solution, or the text of all of them, is too large. findall/3 copies a term, and then
% subterms that were shared are so no longer.
measure([], _) :- !.
measure(Term, _) :- cyclic_term(Term), !.
measure(Term, State) :-
    max_parts(Most),
    term_attvars(Term, Constrained),
    (   \+ \+ ( maplist(del_attrs, Constrained), size_abstract_term(Most, t(Term), Part), Part == t(Term) ) -> true
    ;   format(string(Sentence), "a solution has more than ~D parts", [Most]),
        throw(mindstage_error('PrologGoalError', Sentence))
    ),
    arg(1, State, Left),
    text_cost(Term, Left, Next),
    nb_setarg(1, State, Next).

% text_cost(+Term, +Left, -Next): subtracts the approximate length of the text of a term.
text_cost(Term, Left, Next) :- nonvar(Term), Term = [Head|Tail], !,
    text_cost(Head, Left, Rest),
    text_cost(Tail, Rest, Next).
text_cost(Term, Left, Next) :-
    (   compound(Term) -> compound_name_arguments(Term, Name, Arguments) ; Name = Term, Arguments = [] ),
    (   has_text(Name) -> atom_length(Name, Length) ; Length = 1 ),  % the others are variables, streams, functors of dicts
    Rest is Left - Length - 2,
    (   Rest < 0 -> throw(mindstage_error('PrologGoalError', "the text of the solutions is too long; ask for less")) ; true ),
    foldl(text_cost, Arguments, Rest, Next).

has_text(Value) :- blob(Value, text), !.
has_text(Value) :- string(Value), !.
has_text(Value) :- number(Value).

% Compound terms are converted to text.
cell(Value, Value) :- \+ compound(Value), !.
cell(Value, Cells) :- is_list(Value), !, maplist(cell, Value, Cells).
cell(Value, Cell) :- format(atom(Cell), "~p", [Value]).

error_end(time_limit_exceeded, timed_out) :- !.
error_end(mindstage_interrupted, interrupted) :- !.
error_end('$aborted', interrupted) :- !.
error_end(unwind(abort), interrupted) :- !.
% The context is dropped: it may be as large as the memory limit.
error_end(error(resource_error(What), _), error_reply(prolog, Sentence)) :- !,
    format(string(Sentence), "the memory limit was exceeded (~w)", [What]).
error_end(Error, error_reply(Kind, Sentence)) :-
    (   Error = mindstage_error(Kind, _) -> true ; Kind = prolog ),
    error_message(Error, Text),
    string_length(Text, Length),
    max_message_characters(Most),
    (   Length > Most -> sub_string(Text, 0, Most, _, Start), string_concat(Start, " …", Sentence) ; Sentence = Text ).

max_message_characters(2000).
max_message_parts(200).

% Prolog's error message in one line. The context is internal, except for syntax errors. Large subterms, such as the culprit
% of a type error, are left out: the message is made after the end of the time limit.
error_message(error(Formal, Context), Sentence) :- Formal \= syntax_error(_), nonvar(Context), !,
    error_message(error(Formal, _), Sentence).
error_message(Error, Sentence) :-
    max_message_parts(Most),
    size_abstract_term(Most, t(Error), t(Small)),
    Small \== Error,
    \+ Small = mindstage_error(_, _), !,
    error_message(Small, Sentence).
error_message(Error, Sentence) :-
    '$messages':translate_message(Error, Lines, []),
    with_output_to(string(Text), print_message_lines(current_output, '', Lines)),
    split_string(Text, "\n", " \t", Parts),
    exclude(==(""), Parts, Answers),
    atomic_list_concat(Answers, ' ', Atom),
    atom_string(Atom, Sentence).

% consult_file(+File, -Errors): the number of errors, or interrupted.
consult_file(File, Errors) :-
    statistics(errors, Before),
    catch(user:load_files(File, []), Error, consult_stopped(Error, Stopped)),
    statistics(errors, After),
    (   nonvar(Stopped) -> Errors = Stopped ; Errors is After - Before ).

consult_stopped(mindstage_interrupted, interrupted) :- !.
consult_stopped(Error, _) :- print_message(error, Error).

% on_interrupt(+Action, -Done): sets the action of Ctrl-C: debug, throw or default.
on_interrupt(throw, true) :- !, on_signal(int, _, mindstage_console:interrupted).
on_interrupt(Action, true) :- on_signal(int, _, Action).

interrupted(_) :- throw(mindstage_interrupted).

% -- queries in a pipe -------------------------------------------------------------------------------------------------

% In a terminal, the toplevel reads a key after an answer that may not be the last. From a pipe it would read, and discard,
% the following lines. There, only ; is such a key: whatever else follows is the next query.
:- initialization((
       wrap_predicate('$toplevel':get_respons(Action, _), mindstage_pipe, Wrapped,
                      mindstage_console:pipe_action(Wrapped, Action)),
       wrap_predicate('$toplevel':read_query_line(_, _), mindstage_pipe, Read, mindstage_console:read_pipe_query(Read)))).

:- dynamic explained_pipe/0.

pipe_action(FromTerminal, _) :- stream_property(user_input, tty(true)), !, call(FromTerminal).
pipe_action(_, redo) :- flush_output(user_output), skipped_layout(';'), !,
    get_char(user_input, _),
    format(user_output, ";~n", []).
pipe_action(_, continue) :-
    write(user_output, '.'),
    (   explained_pipe -> true
    ;   assertz(explained_pipe),
        print_message(warning, mindstage_more_answers)
    ).

read_pipe_query(Read) :- \+ stream_property(user_input, tty(true)), skipped_layout(';'), !,  % after the last answer
    get_char(user_input, _),
    read_pipe_query(Read).
read_pipe_query(Read) :- call(Read).

% skipped_layout(?Next): skips layout; Next is the character after it, which is not consumed.
skipped_layout(Next) :-
    peek_char(user_input, Character),
    (   Character \== end_of_file, char_type(Character, space)
    ->  get_char(user_input, _), skipped_layout(Next)
    ;   Next = Character
    ).

% -- exit --------------------------------------------------------------------------------------------------------------

% The last at_halt goal: Python ends the process, see PrologConsole._on_halt in console.py.
at_exit :-
    forall(( clause(system:'$at_halt'(Goal, _), true), Goal \= _:at_exit ), catch(ignore(Goal), _, true)),
    flush_output(user_output),
    flush_output(user_error),
    (   current_prolog_flag(exit_status, Status) -> true ; Status = 0 ),
    request(halting(Status), _).

:- initialization(at_halt(mindstage_console:at_exit)).

% -- messages ----------------------------------------------------------------------------------------------------------

:- multifile prolog:message//1.

prolog:message(mindstage_error(Kind, Sentence)) --> [ '~w'-[Sentence] ], mindstage_console:hint(Kind).
prolog:message(mindstage_interrupted) --> [ 'interrupted' ].
prolog:message(mindstage_more_answers) -->
    [ 'There may be further answers: a line with ; after a query prints the next one, as the key does in a terminal' ].
prolog:message(mindstage_unknown_name(Sentence)) --> [ '~w'-[Sentence] ].
prolog:message(mindstage_failed(Number)) -->
    [ '~D items could not be spawned; debug_failed_items lists them'-[Number] ].
prolog:message(mindstage_not_highlighted(Name, Why)) --> [ '~w cannot be highlighted: ~w'-[Name, Why] ].

hint('BodyNotFoundError') --> !, [ '; spawn_semantic_map(Map) spawns the bodies of a map' ].
hint(_) --> [].
